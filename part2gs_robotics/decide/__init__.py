"""How many parts move, and how: sets of motions judged by surfels and photos together.

In: a `Study` and the pool. Out: a `candidate.Candidate`: motions, carriers, labels, scores.
Call: `grow.decide`; `leave_out` takes parts out again once joints are settled.
"""
