"""Twins and fits in the browser, on this machine alone.

In: a twin folder, or the Gaussians of a fit. Out: a page, until it is interrupted or the fits end.
Call: `server.serve`, `training.watched`.
"""
