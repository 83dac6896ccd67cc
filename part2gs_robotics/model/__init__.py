"""What travels from room to room: frozen values, and the geometry that they share.

A `Scene` of photos becomes `Gaussians`, a `Joint` says how one part moves, a `Motion` holds all of
them with the part of every Gaussian, a `Twin` is what is exported. Nothing here computes for long.
"""
