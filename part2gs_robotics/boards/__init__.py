"""Boards: what photos say about a part's inside, and its likely planes -> a solid of flat faces.

In: a belief on a grid, the noisy surface of the same part, directions of straight edges. Out: a
closed manifold with flat faces and sharp edges, and the convex cells that it is made of. The
function to call is `boards.board_solid.board_solid`.
"""
