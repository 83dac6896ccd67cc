"""Volume: depth maps of both states -> what every part fills on a grid.

In: Gaussians of both states, part identities, joints. Out: evidence per voxel and part, and solids
that keep out of each other's way. Call: `volume.grid_solids`, in the order of its functions.
"""
