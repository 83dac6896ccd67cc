"""Writers of the twin: MJCF and URDF."""
