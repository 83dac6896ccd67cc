"""Steps of a simulation that look for contacts only where there may be one: same result, sooner.

Between parts that do not touch, most of a step goes into finding that they still do not. A look
with a margin names the pairs that are near, each with a direction along which it is apart, and by
how much at least: the corners say it exactly. What a joint's motion takes of that gap is bounded,
so until the joints have used it up the engine steps without looking: it would have found nothing,
and comes to the same numbers bit by bit. Where something touches, it steps as ever.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.assets.driven import is_simple
from part2gs_robotics.model.arrays import F64

if TYPE_CHECKING:
    import mujoco

FEWEST = 16  # shapes that collide: with fewer a look costs less than knowing when to
NEAR = 0.005  # of the size: margin of a look; farther pairs share one bound
USED = 0.9  # of a gap that motion may use: the rest is rounding
TOLERANCES = 4.0  # of the engine's search for the nearest points: a gap it may take for a touch
AS_EVER = 16  # steps with contacts after a look that found too little room
SHORT = 4  # steps: where looks last no longer they cost more than they save
FEW_PAIRS = 12  # near each other: finding that they do not touch is quick
QUICK = 250  # steps as ever after a look that found so few


@dataclass(frozen=True)
class Shapes:
    """What of a model's shapes bounds need.

    Attributes:
        corners: [G, 8, 3] of the box around each in its frame.  boxes: [G] whether it is that box.
        meets: [G] whether it collides.  moved: [G, J] whether a joint moves it.  slide: [J].
        near: margin of a look, units.
    """

    corners: F64
    boxes: NDArray[np.bool_]
    meets: NDArray[np.bool_]
    moved: NDArray[np.bool_]
    slide: NDArray[np.bool_]
    near: float


def shapes_of(model: mujoco.MjModel) -> Shapes | None:
    """Return the shapes of a model; None where looks are few, or bounds unknown.

    Bounds are for hinges and slides, and for meshes and boxes without a margin.
    """
    import mujoco

    types, meets = mujoco.mjtGeom, (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    boxes = model.geom_type == int(types.mjGEOM_BOX)
    plain = boxes | (model.geom_type == int(types.mjGEOM_MESH)) | ~meets
    odd = model.npair or model.nflex or model.geom_margin.any() or model.geom_gap.any()
    simple = all(is_simple(model, j) for j in range(model.njnt))
    if meets.sum() < FEWEST or not model.njnt or not plain.all() or odd or not simple:
        return None
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), -1).reshape(-1, 3)
    corners = model.geom_aabb[:, None, :3] + signs * model.geom_aabb[:, None, 3:]
    slide = model.jnt_type == int(mujoco.mjtJoint.mjJNT_SLIDE)
    return Shapes(np.asarray(corners), boxes, meets, _moved(model), slide,
                  NEAR * float(model.stat.extent))


def _moved(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return [G, J] whether a joint moves a shape."""
    by_body = np.zeros((model.nbody, model.njnt), bool)
    for body in range(1, model.nbody):  # parents come first
        by_body[body] = by_body[model.body_parentid[body]]
        first = int(model.body_jntadr[body])
        by_body[body, first:first + int(model.body_jntnum[body])] = first >= 0
    return np.asarray(by_body[model.geom_bodyid])


def _looks_once(model: mujoco.MjModel) -> bool:
    """Return whether a step looks for contacts once, where it begins, and nothing else counts."""
    import mujoco

    kinds, bits = mujoco.mjtIntegrator, mujoco.mjtEnableBit
    once = (kinds.mjINT_EULER, kinds.mjINT_IMPLICIT, kinds.mjINT_IMPLICITFAST)
    return (int(model.opt.integrator) in [int(k) for k in once]
            and not model.opt.enableflags & ~int(bits.mjENBL_ENERGY))


def _corners(model: mujoco.MjModel, geom: int) -> F64:
    """Return [C, 3] corners of a shape's hull in its own frame."""
    import mujoco

    if model.geom_type[geom] == int(mujoco.mjtGeom.mjGEOM_BOX):
        signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), -1).reshape(-1, 3)
        return np.asarray(signs * model.geom_size[geom])
    mesh = int(model.geom_dataid[geom])
    first = int(model.mesh_vertadr[mesh])
    return np.asarray(model.mesh_vert[first:first + int(model.mesh_vertnum[mesh])], np.float64)


def _moved(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return [G, J] whether a joint moves a shape."""
    by_body = np.zeros((model.nbody, model.njnt), bool)
    for body in range(1, model.nbody):  # parents come first
        by_body[body] = by_body[model.body_parentid[body]]
        first = int(model.body_jntadr[body])
        by_body[body, first:first + int(model.body_jntnum[body])] = first >= 0
    return np.asarray(by_body[model.geom_bodyid])


class Stepper:
    """Steps one simulation."""

    def __init__(self, shapes: Shapes | None, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Look at nothing yet.

        Args:
            shapes: of the model, or None to step as the engine does.
            model: its options and gains may be other ones than when the shapes were made.
            data: of the simulation.
        """
        import mujoco

        self.model, self.data, self.as_ever, self.lasted = model, data, 0, SHORT
        self.shapes = shapes if _looks_once(model) else None
        if self.shapes is None:
            return
        self.blind, self.wide = copy(model), copy(model)
        self.blind.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self.wide.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MULTICCD)
        self.wide.geom_margin[self.shapes.meets] = self.shapes.near
        self.wide.body_margin[:] = self.shapes.near
        self.look = mujoco.MjData(self.wide)
        self.rates, self.origin = np.full(model.nv, np.inf), data.qpos + np.inf

    def step(self, count: int) -> None:
        """Take some steps, as mj_step does."""
        import mujoco

        if self.shapes is None:
            mujoco.mj_step(self.model, self.data, count)
            return
        while count > 0:
            if self.as_ever:
                ahead = min(count, self.as_ever)
                mujoco.mj_step(self.model, self.data, ahead)
                self.as_ever -= ahead
                count -= ahead
            elif self.rates @ np.abs(self.data.qpos - self.origin) < 1.0:
                mujoco.mj_step(self.blind, self.data)
                self.lasted += 1
                count -= 1
            else:
                self.as_ever = AS_EVER if self.lasted < SHORT else self._looked(self.shapes)
                self.lasted = SHORT if self.as_ever else 0

    def _looked(self, shapes: Shapes) -> int:
        """Look with a margin and note how far joints may go; return steps to take as ever."""
        import mujoco

        look = self.look
        self.origin = self.data.qpos.copy()
        if not np.isfinite(self.origin).all():
            return QUICK
        look.qpos[:] = self.origin
        mujoco.mj_kinematics(self.wide, look)
        mujoco.mj_collision(self.wide, look)
        if look.ncon < FEW_PAIRS:
            return QUICK
        gaps, closed = _near(shapes, look)
        gaps = USED * gaps - TOLERANCES * self.model.opt.ccd_tolerance
        if (gaps <= 0).any() or look.warning[int(mujoco.mjtWarning.mjWARN_CONTACTFULL)].number:
            return AS_EVER
        far = _far(shapes, self.wide, look) / (USED * shapes.near)
        self.rates = np.maximum((closed / gaps[:, None]).max(0), far)
        return 0


def _near(shapes: Shapes, look: mujoco.MjData) -> tuple[F64, F64]:
    """Return [P] gaps of near pairs, and [P, J] by how much a unit of each joint may close them.

    Along the direction between two shapes a slide closes by its share of it; a hinge by the
    arm of the farthest corner, and as much more as points may have moved until the next look.
    """
    geoms, way = np.array(look.contact.geom), np.array(look.contact.frame[:, :3])
    turned = look.geom_xmat[geoms].reshape(-1, 2, 3, 3).swapaxes(2, 3)
    corners = shapes.corners[geoms] @ turned + look.geom_xpos[geoms][:, :, None]  # [P, 2, 8, 3]
    lever = np.cross(way[:, None], look.xaxis)  # [P, J, 3]
    arms = corners @ lever.swapaxes(1, 2)[:, None] - (look.xanchor * lever).sum(2)[:, None, None]
    arms = np.abs(arms).max(2) + 1.5 * shapes.near  # [P, 2, J]
    arms = np.where(shapes.slide, np.abs(way @ look.xaxis.T)[:, None], arms)
    moved = shapes.moved[geoms]
    one = moved & (moved[:, :1] != moved[:, 1:])
    along = (corners @ way[:, None, :, None])[..., 0]
    boxes = along.min(2)[:, 1] - along.max(2)[:, 0]  # of two boxes the engine tells less
    both = shapes.boxes[geoms].all(1)
    return np.where(both, boxes, look.contact.dist), np.where(one, arms, 0.0).max(1)


def _far(shapes: Shapes, model: mujoco.MjModel, look: mujoco.MjData) -> F64:
    """Return [J] how far a unit of each joint may move any point of a shape that collides."""
    reach = np.linalg.norm(look.geom_xpos[:, None] - look.xanchor, axis=2)
    reach = reach + model.geom_rbound[:, None] + shapes.near
    reach = np.where(shapes.moved & shapes.meets[:, None], reach, 0.0).max(0)
    return np.asarray(np.where(shapes.slide, 1.0, reach))
