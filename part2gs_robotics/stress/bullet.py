"""A ball thrown at a wall: how thick must a wall be, how slow a ball, to be stopped."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.stress.cells import Cell

if TYPE_CHECKING:
    import mujoco

WALLS = (1e-3, 3e-3, 1e-2, 3e-2, 1e-1)  # of the size, thickness
SPEEDS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)  # sizes per second
BALL = 0.01  # of the size, its radius
AWAY = 0.05  # of the size: where it starts, before the wall
BISECTIONS = 12  # of the fastest ball that a wall stops: to 0.1 % of a factor of a thousand


def walls(model: mujoco.MjModel, size: float) -> list[Cell]:
    """Return a cell per wall and speed: whether the ball came through.

    Error is 1 where it did, in the model's own options and stiffness of contacts.

    Args:
        model: of the asset.
        size: of it, units.
    """
    return [thrown(model, size, wall, speed) for wall in WALLS for speed in SPEEDS]


def thrown(model: mujoco.MjModel, size: float, wall: float, speed: float) -> Cell:
    """Return whether a ball of a speed (sizes/s) comes through a wall (of the size)."""
    import mujoco

    made = _range(model, size, wall)
    data = mujoco.MjData(made)
    data.qvel[0] = speed * size
    step, beyond, deepest = made.opt.timestep, wall * size + BALL * size, 0.0
    for _ in range(int(np.ceil(2 * (AWAY + wall) / speed / step)) + 50):
        mujoco.mj_step(made, data)
        deepest = max(deepest, -float(data.contact.dist.min(initial=0.0)))
        if data.qpos[0] - AWAY * size - BALL * size > beyond or data.qvel[0] < 0:
            break
    through = bool(data.qpos[0] - (AWAY + BALL) * size > wall * size / 2)
    finite = bool(np.isfinite(data.qpos).all())
    return Cell({"wall": wall, "speed": speed}, "diverged" if through or not finite else "ok",
                float(through), 0.0, deepest)


def _range(model: mujoco.MjModel, size: float, wall: float) -> mujoco.MjModel:
    """Return a ball on a rail before a wall that begins at (AWAY + BALL) of the size."""
    import mujoco

    strikes = np.flatnonzero((model.geom_contype != 0) | (model.geom_conaffinity != 0))
    g = int(strikes[-1]) if len(strikes) else -1
    rules = "" if g < 0 else ('solref="' + " ".join(map(repr, model.geom_solref[g].tolist()))
                              + '" solimp="' + " ".join(map(repr, model.geom_solimp[g].tolist()))
                              + '"')
    middle = (AWAY + BALL + wall / 2) * size
    made = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 0"/><worldbody><geom type="box" pos="{middle:.17g} 0 0" '
        f'size="{wall * size / 2:.17g} {size:.17g} {size:.17g}" {rules}/><body><joint type="slide" '
        f'axis="1 0 0"/><geom size="{BALL * size:.17g}" mass="1" {rules}/></body></worldbody>'
        "</mujoco>")
    for name in ("timestep", "integrator", "solver", "iterations", "tolerance", "cone",
                 "impratio", "jacobian"):
        setattr(made.opt, name, getattr(model.opt, name))
    return made


def thinnest(model: mujoco.MjModel) -> float:
    """Return the smallest thickness of a box around anything that collides, units; inf = none."""
    import mujoco

    plane = int(mujoco.mjtGeom.mjGEOM_PLANE)
    solid = ((model.geom_contype != 0) | (model.geom_conaffinity != 0)) & (model.geom_type != plane)
    return float(2 * model.geom_aabb[solid, 3:].min(initial=np.inf))


def fastest(model: mujoco.MjModel, size: float, wall: float) -> float:
    """Return the highest speed, sizes/s, at which a wall (of the size) still stops the ball."""
    low, high = SPEEDS[0] / 10, SPEEDS[-1]
    if thrown(model, size, wall, low).error:
        return 0.0
    if not thrown(model, size, wall, high).error:
        return high
    for _ in range(BISECTIONS):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if thrown(model, size, wall, middle).error else (middle, high)
    return low
