"""What both states show, gathered once: surfaces, what left, what arrived, edges, faces, light.

In: a `Scene` and the Gaussians of both states. Out: `canonical.Canonical` (both states comparable),
then `study.Study` (all that the search looks at).
Call: `canonical.canonical`, then `study.gather`.
"""
