"""The motions that were decided on, brought to where the photos want them, and hung on one another.

In: a `Candidate` and photos of both states. Out: a `Candidate` with aligned joints.
Call: `carried.nest`; `align.align` is the second-order fit to the photos, `claim.claim` the labels.
"""
