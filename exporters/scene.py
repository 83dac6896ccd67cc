"""scene.xml: the actuated twin with everything that counts for a whole model.

Options, ground, sky and light stand here and nowhere else, so that the twin alone can be included
in, or attached to, a world that has its own.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from part2gs_robotics.exporters.dynamics import Physics
from part2gs_robotics.exporters.xmlio import add
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.kinematics import moving_parts, part_transforms
from part2gs_robotics.model.solids import bounds
from part2gs_robotics.model.twin import Twin

GROUND_GAP = 0.01  # of the size: the ground stays this far below everything that moves
SIDE_LIGHT = 0.4  # of the way up: light that comes aslant shows which way a face looks


def _options(root: ET.Element, physics: Physics) -> None:
    # implicitfast, elliptic, impratio: the manual's tuning table
    # dense: the sparse Newton solver of 4.0.0 has a wrong Hessian
    add(
        root,
        "option",
        timestep=physics.step,
        gravity=physics.gravity,
        integrator="implicitfast",
        cone="elliptic",
        impratio=10,
        jacobian="dense",
    )


def scene_xml(twin: Twin, physics: Physics) -> ET.Element:
    """Return the <mujoco> element that includes the actuated twin and adds a world to it."""
    root = ET.Element("mujoco", model=f"{twin.name}_scene")
    add(root, "include", file="twin_actuated.xml")
    _options(root, physics)
    low, high = bounds(tuple(p.mesh for p in twin.parts))
    size, middle = float(np.linalg.norm(high - low)), (low + high) / 2
    up = -physics.gravity / np.linalg.norm(physics.gravity)
    add(root, "statistic", center=middle, extent=size)
    look = add(root, "visual")
    add(look, "headlight", ambient=(0.3, 0.3, 0.3), diffuse=(0.4, 0.4, 0.4), specular=(0, 0, 0))
    _materials(add(root, "asset"))
    world = add(root, "worldbody")
    floor = middle + up * (_lowest(twin, up) - GROUND_GAP * size - float(up @ middle))
    wide = (3 * size, 3 * size, 0.1 * size)
    add(
        world,
        "geom",
        name="ground",
        type="plane",
        pos=floor,
        zaxis=up,
        size=wide,
        material="ground",
    )
    aside = SIDE_LIGHT * np.eye(3)[int(np.argmin(np.abs(up)))]
    way = (up + aside) / np.linalg.norm(up + aside)
    add(
        world,
        "light",
        name="sun",
        pos=middle + 3 * size * way,
        dir=-way,
        directional="true",
        diffuse=(0.5, 0.5, 0.5),
        specular=(0.1, 0.1, 0.1),
    )
    return root


def _materials(asset: ET.Element) -> None:
    grey, pale, blue = (0.65, 0.65, 0.65), (0.75, 0.75, 0.75), (0.55, 0.65, 0.8)
    add(
        asset,
        "texture",
        name="sky",
        type="skybox",
        builtin="gradient",
        rgb1=blue,
        rgb2=(0.95, 0.95, 0.97),
        width="256",
        height="1536",
    )
    add(
        asset,
        "texture",
        name="ground",
        type="2d",
        builtin="checker",
        rgb1=pale,
        rgb2=grey,
        width="300",
        height="300",
    )
    add(asset, "material", name="ground", texture="ground", texrepeat=(8, 8))


def _lowest(twin: Twin, up: F64) -> float:
    """Return the lowest height any part reaches along its range, other joints at 0, or at state 1.

    Pieces count as well: they may stick out of their part.
    """
    moving, lowest = moving_parts(twin), np.inf
    poses = [[part.joint.value for i in moving if (part := twin.parts[i]).joint is not None]]
    for slot, index in enumerate(moving):
        for q in np.linspace(*twin.parts[index].limits, 9):
            poses.append([float(q) if i == slot else 0.0 for i in range(len(moving))])
    for positions in poses:
        for part, place in zip(twin.parts, part_transforms(twin, positions), strict=True):
            points = np.concatenate([m.vertices for m in (part.mesh, *part.pieces)])
            lowest = min(lowest,
                         float((points @ (place[:3, :3].T @ up)).min() + up @ place[:3, 3]))
    return min(lowest, *(float((p.mesh.vertices @ up).min()) for p in twin.parts))
