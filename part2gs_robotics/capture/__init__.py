"""An articulated model to a two-state scene with ground truth, drawn by MuJoCo.

In: a MJCF or URDF file. Out: a scene folder, and its truth beside it.
Call: `capture.capture`.
"""
