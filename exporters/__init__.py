"""The twin as files that simulators and people open.

In: `model.twin.Twin`. Out: MJCF, URDF, twin.yaml, meshes and Gaussians in a folder.
Call: `mjcf.write_mjcf`, `urdf.write_urdf`, `twin_yaml.write_twin_yaml`.
"""
