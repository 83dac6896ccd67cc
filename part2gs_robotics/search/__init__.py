"""Motions that may explain what moved, none of them decided on.

In: a `Study`. Out: a list of `Joint`, the pool.
Call: `pool.find_pool`; `refine.refine` brings one motion to where it lands best.
"""
