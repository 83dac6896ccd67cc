"""The world around a twin: a level ground, and nothing in the way of any joint."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.agree.finding import CheckResult, fails, passes
from part2gs_robotics.model.arrays import F64

if TYPE_CHECKING:
    import mujoco

DEEP = 2.0  # of the size that the ground may lie below the twin; ours is just clear of it
LEVEL = 0.9999  # cosine between ground and gravity: 0.8 degrees, on which nothing rolls
DIM = 0.1  # of full light, of all lights together; ours give 1.2
NEAR, FAR = 0.3, 5.0  # of the size: what a camera beside the object sees; the engine's 0.01, 50
REACH = 129  # positions of every joint: 1.4 degrees of half a turn, 8 mm at 0.35 m


def clear_world(model: mujoco.MjModel) -> list[CheckResult]:
    """Return what of the world touches the twin at its observed states, or on a joint's way."""
    import mujoco

    data = mujoco.MjData(model)
    for name, qpos in _poses(model):
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(model, data)
        for c in range(data.ncon):
            geoms = [int(g) for g in data.contact[c].geom]
            if 0 in [int(model.geom_bodyid[g]) for g in geoms]:
                one, two = (model.geom(g).name or f"geom {g}" for g in geoms)
                return [fails("clear world", "scene.xml", f"{one} touches {two} at {name}",
                              f"scene.xml: move {one} or {two} away")]
    clear = passes("clear world", "scene.xml", "ground is clear of it")
    return _sunk(model) + _ground(model) + _dark(model) or [clear]


def _sunk(model: mujoco.MjModel) -> list[CheckResult]:
    """Return a ground that stands still in a part that does: the engine looks for no contact."""
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    planes = np.flatnonzero((model.geom_type == int(mujoco.mjtGeom.mjGEOM_PLANE))
                            & (model.geom_bodyid == 0))
    still = (model.body_weldid[model.geom_bodyid] == 0) & (model.geom_bodyid > 0)
    for g in np.flatnonzero(still & (model.geom_contype | model.geom_conaffinity != 0)):
        corners = _corners(model, int(g)) @ data.geom_xmat[g].reshape(3, 3).T + data.geom_xpos[g]
        for p in planes:
            up = data.geom_xmat[p].reshape(3, 3)[:, 2]
            if float(((corners - data.geom_xpos[p]) @ up).min(initial=np.inf)) < 0:
                one, two = model.geom(int(p)).name or f"geom {p}", model.geom(int(g)).name
                return [fails("clear world", "scene.xml", f"{one} cuts {two or f'geom {g}'}",
                              f"scene.xml: move {one} below the twin")]
    return []


def _corners(model: mujoco.MjModel, g: int) -> F64:
    """Return the [N, 3] corners of a mesh or box in its own frame, none of other shapes."""
    import mujoco

    if model.geom_type[g] == int(mujoco.mjtGeom.mjGEOM_BOX):
        signs = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), -1).reshape(-1, 3)
        return np.asarray(signs * model.geom_size[g], np.float64)
    if (mesh := int(model.geom_dataid[g])) < 0:
        return np.zeros((0, 3))
    first = int(model.mesh_vertadr[mesh])
    return np.asarray(model.mesh_vert[first:first + int(model.mesh_vertnum[mesh])], np.float64)


def _poses(model: mujoco.MjModel) -> Iterator[tuple[str, F64]]:
    """Yield keyframes, and REACH positions of every joint alone, couplings left as they are."""
    for k in range(model.nkey):
        yield model.key(k).name, np.array(model.key_qpos[k])
    for j in np.flatnonzero(model.jnt_limited):
        for q in np.linspace(float(model.jnt_range[j, 0]), float(model.jnt_range[j, 1]), REACH):
            pose = np.array(model.qpos0)
            pose[model.jnt_qposadr[j]] = q
            yield f"{model.joint(int(j)).name} {q:.4g}", pose


def _ground(model: mujoco.MjModel) -> list[CheckResult]:
    """Return that there is no level, solid ground."""
    import mujoco

    planes = np.flatnonzero((model.geom_type == int(mujoco.mjtGeom.mjGEOM_PLANE))
                            & (model.geom_bodyid == 0))
    down = np.array(model.opt.gravity) / max(float(np.linalg.norm(model.opt.gravity)), 1e-300)
    for g in planes:
        frame = np.zeros(9)
        mujoco.mju_quat2Mat(frame, model.geom_quat[g])
        level = float(frame.reshape(3, 3)[:, 2] @ down) < -LEVEL
        below = float((model.geom_pos[g] - model.stat.center) @ down)
        near = below < DEEP * 2 * float(model.stat.extent)
        if level and near and (model.geom_contype[g] or model.geom_conaffinity[g]):
            return []
    return [fails("clear world", "scene.xml", "has no level ground near it that things rest on",
                  "scene.xml: add a plane below the twin, its zaxis up, or build the twin again")]


def _dark(model: mujoco.MjModel) -> list[CheckResult]:
    """Return that a viewer shows nothing of the world: no light, or cut off by its planes."""
    head, near = model.vis.headlight, float(model.vis.map.znear)
    shine = float(np.max(head.ambient)) + float(np.max(head.diffuse)) if head.active else 0.0
    for k in np.flatnonzero(model.light_active):
        shine += float(max(model.light_ambient[k].max(), model.light_diffuse[k].max()))
    if shine < DIM:
        return [fails("clear world", "scene.xml", f"its lights add up to {shine:.2g} of 1: viewers "
                      "show it black", "scene.xml: remove <headlight> and active of <light>")]
    if not near <= NEAR or not model.vis.map.zfar >= FAR:
        return [fails("clear world", "scene.xml", "viewers cut off what is nearer than "
                      f"{near:g} or farther than {model.vis.map.zfar:g} times its size",
                      "scene.xml: remove znear and zfar of <map>")]
    return []
