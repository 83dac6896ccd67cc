"""Collision: a closed mesh -> few convex pieces that a physics engine collides instead of it.

In: the mesh of a part. Out: convex meshes, none with many corners. The function to call is
`collision.convex.convex_pieces`.
"""
