"""A finished twin in the browser, moved by hand, with MuJoCo behind it.

In: a twin folder. Out: a server on this machine alone, until it is interrupted.
Call: `server.serve`.
"""
