"""How long a scene unit is: said, derived from a known length, or assumed; told in one sentence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from part2gs_robotics.model.kinematics import moving_parts, part_transforms
from part2gs_robotics.model.twin import Twin

ASSUMED = "Scale assumed"  # how the note begins when nobody knows the scale


def longest_side(twin: Twin) -> float:
    """Return the longest side of the object's smallest box, in its more compact state, units."""
    import trimesh

    moving, sides = moving_parts(twin), []
    for state in (0, 1):
        joints = [twin.parts[i].joint for i in moving]
        places = part_transforms(twin, [state * j.value for j in joints if j is not None])
        points = np.concatenate([p.mesh.vertices @ place[:3, :3].T + place[:3, 3]
                                 for p, place in zip(twin.parts, places, strict=True)])
        _, extents = trimesh.bounds.oriented_bounds(points - points.mean(0))
        sides.append(float(np.max(extents)))
    return min(sides)


def with_scale(twin: Twin, known_length: float | None) -> Twin:
    """Return the twin with its scale, and a note that says where that is from.

    Args:
        twin: in scene units.
        known_length: metres of the longest side; None = the twin's own scale, known or assumed.
    """
    side = longest_side(twin)
    if known_length is not None:
        note = f"{known_length:g} m over the longest side of {side:.4g} units"
        twin = replace(twin, meters_per_unit=known_length / side, scale_note=note)
    length = f"1 unit = {twin.meters:.4g} m"
    if twin.meters_per_unit is None:
        told = (f"{ASSUMED}: {length}, so the longest side is {side * twin.meters:.3g} m. Masses "
                "and gravity follow from it; --scale or --known-length says it.")
    else:
        told = f"Scale: {length}, {twin.scale_note}; longest side {side * twin.meters:.3g} m."
    return replace(twin, notes=(*twin.notes, told))
