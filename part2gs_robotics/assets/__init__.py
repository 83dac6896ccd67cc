"""Models of anyone's: files made safe to open, names resolved, what moves and by which servo.

In: an MJCF, URDF or USD file. Out: files that lie in their folder (`model_files`), the joints of a
compiled model (`driven`), servos for those without one.
Call: `check_model_files`, `driven_joints`.
"""
