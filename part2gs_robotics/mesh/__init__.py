"""Parts to closed meshes and convex pieces.

In: photos, Gaussians and a `Motion`. Out: `model.twin.Part`s, apart from each other on all ways.
Call: `real_parts.build_existing`, then `clearance.separate_pieces`.
"""
