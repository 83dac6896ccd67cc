"""Plain faces: where flat faces without texture lie, by what photos see of their rims.

In: photos, bounds and depth maps of one state. Out: depth maps.
Call: `plain_faces.with_plain_faces`, once for each state without depth images, if it is asked for.
"""
