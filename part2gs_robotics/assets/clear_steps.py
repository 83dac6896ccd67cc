"""Steps of a simulation that look for contacts only where there may be one: same result, sooner.

Between parts that do not touch, most of a step goes into finding that they still do not. A look
with a margin names the pairs that are near, each with a direction along which it is apart, and by
how much at least: the corners say it exactly. What a joint's motion takes of that gap is bounded,
so until the joints have used it up the engine steps without looking: it would have found nothing,
and comes to the same numbers bit by bit. Such a room depends on the joints alone, so one that
another simulation of the same shapes found serves as well. Where something touches, it steps as
ever.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.assets.clear_rooms import Room, Rooms
from part2gs_robotics.assets.driven import is_simple
from part2gs_robotics.model.arrays import F64

if TYPE_CHECKING:
    import mujoco

FEWEST = 16  # shapes that collide: with fewer a look costs less than knowing when to
MOST_CORNERS = 128  # of a mesh: twice those of our pieces; with more a look costs too much
NEAR = 0.007  # of the size: margin of a look; farther pairs share one bound
USED = 0.9  # of a gap that motion may use: the rest is rounding
TOLERANCES = 4.0  # of the engine's search for the nearest points: a gap it may take for a touch
AS_EVER = 16  # steps with contacts after a look that found too little room
SHORT = 4  # steps: where looks last no longer they cost more than they save
FEW_PAIRS = 12  # near each other: finding that they do not touch is quick
QUICK = 250  # steps as ever after a look that found so few

RULES = ("geom_contype", "geom_conaffinity", "geom_margin", "geom_gap", "exclude_signature",
         "npair", "nflex")  # fmt: skip  # what of a model decides which of its shapes meet
OPTIONS = ("disableflags", "enableflags", "ccd_tolerance", "ccd_iterations")  # and of its options


@dataclass(frozen=True)
class Shapes:
    """What of a model's shapes bounds need.

    Attributes:
        boxes: [G, 8, 3] corners of the box around each in its frame.  corners: [G, C, 3] its own.
        meets: [G] whether it collides.  moved: [G, J] whether a joint moves it.  slide: [J].
        carried: [J, J] whether the second joint moves the first.
        wide: the model with a margin, for looks.  near: that margin, units.
        rooms: in which nothing touches, found by any simulation of these shapes.
    """

    boxes: F64
    corners: F64
    meets: NDArray[np.bool_]
    moved: NDArray[np.bool_]
    slide: NDArray[np.bool_]
    carried: NDArray[np.bool_]
    wide: mujoco.MjModel
    near: float
    rooms: Rooms


def shapes_of(model: mujoco.MjModel) -> Shapes | None:
    """Return the shapes of a model; None where looks are few, or bounds unknown.

    Bounds are for hinges and slides, and for small meshes and boxes without a margin.
    """
    import mujoco

    types, meets = mujoco.mjtGeom, (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    plain = np.isin(model.geom_type, [int(types.mjGEOM_BOX), int(types.mjGEOM_MESH)]) | ~meets
    odd = model.npair or model.nflex or model.geom_margin.any() or model.geom_gap.any()
    simple = all(is_simple(model, j) for j in range(model.njnt))
    if meets.sum() < FEWEST or not model.njnt or not plain.all() or odd or not simple:
        return None
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), -1).reshape(-1, 3)
    boxes = np.asarray(model.geom_aabb[:, None, :3] + signs * model.geom_aabb[:, None, 3:])
    own = [_corners(model, g) if meets[g] else boxes[g] for g in range(model.ngeom)]
    if max(len(c) for c in own) > MOST_CORNERS:
        return None
    corners = np.stack([np.resize(c, (max(len(c) for c in own), 3)) for c in own])
    near, wide = NEAR * float(model.stat.extent), copy(model)
    wide.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MULTICCD)
    wide.geom_margin[meets] = near
    wide.body_margin[:] = near
    by_body, order = _moved(model), np.arange(model.njnt)
    return Shapes(boxes, corners, meets, by_body[model.geom_bodyid],
                  model.jnt_type == int(mujoco.mjtJoint.mjJNT_SLIDE),
                  by_body[model.jnt_bodyid] & (order < order[:, None]), wide, near,
                  Rooms(model.nv))


def _corners(model: mujoco.MjModel, geom: int) -> F64:
    """Return [C, 3] corners of a box or mesh in its own frame."""
    import mujoco

    if model.geom_type[geom] == int(mujoco.mjtGeom.mjGEOM_BOX):
        signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), -1).reshape(-1, 3)
        return np.asarray(signs * model.geom_size[geom])
    mesh = int(model.geom_dataid[geom])
    first = int(model.mesh_vertadr[mesh])
    return np.asarray(model.mesh_vert[first:first + int(model.mesh_vertnum[mesh])], np.float64)


def same_rules(one: mujoco.MjModel, two: mujoco.MjModel) -> bool:
    """Return whether the same shapes, equally placed, may meet in two models."""
    options = all(getattr(one.opt, name) == getattr(two.opt, name) for name in OPTIONS)
    return options and all(np.array_equal(getattr(one, n), getattr(two, n)) for n in RULES)


def _moved(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return [B, J] whether a joint moves a body."""
    by_body = np.zeros((model.nbody, model.njnt), bool)
    for body in range(1, model.nbody):  # parents come first
        by_body[body] = by_body[model.body_parentid[body]]
        first = int(model.body_jntadr[body])
        by_body[body, first:first + int(model.body_jntnum[body])] = first >= 0
    return by_body


def _looks_once(model: mujoco.MjModel) -> bool:
    """Return whether a step looks for contacts once, where it begins, and nothing else counts."""
    import mujoco

    kinds, bits = mujoco.mjtIntegrator, mujoco.mjtEnableBit
    once = (kinds.mjINT_EULER, kinds.mjINT_IMPLICIT, kinds.mjINT_IMPLICITFAST)
    return (int(model.opt.integrator) in [int(k) for k in once]
            and not model.opt.enableflags & ~int(bits.mjENBL_ENERGY))


class Stepper:
    """Steps one simulation."""

    def __init__(self, shapes: Shapes | None, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Look at nothing yet.

        Args:
            shapes: of the model, or None to step as the engine does.
            model: its options and gains may be other ones than when the shapes were made.
            data: of the simulation.
        """
        self.model, self.data, self.as_ever, self.lasted = model, data, 0, SHORT
        self.shapes = shapes if _looks_once(model) else None
        self.blind: mujoco.MjModel | None = None  # made when needed, as what looks
        self.look: mujoco.MjData | None = None
        self.origin = self.even = self.odd = np.full(model.nv, np.nan)  # no room: look first

    def step(self, count: int) -> None:
        """Take some steps, as mj_step does."""
        import mujoco

        if self.shapes is None:
            mujoco.mj_step(self.model, self.data, count)
            return
        qpos = self.data.qpos
        while count > 0:
            if self.as_ever:
                ahead = min(count, self.as_ever)
                mujoco.mj_step(self.model, self.data, ahead)
                self.as_ever -= ahead
                count -= ahead
                continue
            way = qpos - self.origin
            if self.even @ np.abs(way) + self.odd @ way < 1.0:
                mujoco.mj_step(self.blind, self.data)
                self.lasted += 1
                count -= 1
            else:
                self._next_room(self.shapes)

    def _next_room(self, shapes: Shapes) -> None:
        """Find the room around the joints, or say how many steps are taken as ever."""
        import mujoco

        room = shapes.rooms.around(self.data.qpos)
        if room is None and self.lasted < SHORT:
            self.as_ever = AS_EVER
        elif room is None:
            self.lasted = 0
            self.as_ever, room = self._looked(shapes)
        self.lasted = SHORT if self.as_ever else self.lasted
        self.origin, self.even, self.odd = room or (np.full(self.model.nv, np.nan),) * 3
        if room is not None and self.blind is None:
            self.blind = copy(self.model)
            self.blind.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)

    def _looked(self, shapes: Shapes) -> tuple[int, Room | None]:
        """Look with a margin; return how far joints may go, or how many steps to take as ever."""
        import mujoco

        if not np.isfinite(self.data.qpos).all():
            return QUICK, None
        look = self.look = self.look or mujoco.MjData(shapes.wide)
        look.qpos[:] = self.data.qpos
        mujoco.mj_kinematics(shapes.wide, look)
        mujoco.mj_collision(shapes.wide, look)
        if look.ncon < FEW_PAIRS:
            return QUICK, None
        far = _far(shapes, look)
        gaps, closed = _near(shapes, look, far)
        gaps = USED * gaps - TOLERANCES * shapes.wide.opt.ccd_tolerance
        if (gaps <= 0).any() or look.warning[int(mujoco.mjtWarning.mjWARN_CONTACTFULL)].number:
            return AS_EVER, None
        up, down = np.maximum((closed / gaps[:, None, None]).max(0), far / (USED * shapes.near))
        room = look.qpos.copy(), 0.5 * (up + down), 0.5 * (up - down)
        shapes.rooms.add(room)
        return 0, room


def _near(shapes: Shapes, look: mujoco.MjData, far: F64) -> tuple[F64, F64]:
    """Return [P] gaps of near pairs, and [P, 2, J] how a unit of each joint up, down closes them.

    Along the direction between two shapes a slide closes by its share of it; a hinge by the arm of
    the corner that comes nearest. Both by as much more as directions and arms may have turned until
    the next look: points move by less than the margin, hinges by that over the arm [J] of `far`.
    """
    geoms, way = np.array(look.contact.geom), np.array(look.contact.frame[:, :3])
    turned, places = look.geom_xmat[geoms].reshape(-1, 2, 3, 3), look.geom_xpos[geoms]
    boxes = shapes.boxes[geoms] @ turned.swapaxes(2, 3) + places[:, :, None]  # [P, 2, 8, 3]
    lever = (way @ np.cross(np.eye(3), look.xaxis[:, None])).swapaxes(0, 1)  # [P, J, 3] way x axis
    arms = boxes @ lever.swapaxes(1, 2)[:, None] - (lever * look.xanchor).sum(2)[:, None, None]
    slides = (way @ look.xaxis.T)[:, None, None]
    speed = np.where(shapes.slide, slides, arms) * np.array([1.0, -1.0])[:, None, None]
    # of the first shape ahead, of the second shape back: what comes closer; [P, 2, J]
    up, down = speed.max(2), -speed.min(2)
    turns = np.where(shapes.carried & ~shapes.slide, 1.0 / np.maximum(far, 1e-300), 0.0).max(1)
    slack = np.where(shapes.slide, turns, 1.5) * shapes.near
    moved = shapes.moved[geoms]
    one = moved & (moved[:, :1] != moved[:, 1:])
    closed = np.where(one[:, None], np.maximum(np.stack([up, down], 1), 0.0) + slack, 0.0).max(2)
    # the engine's own distance is wrong where its search did not come to an end
    along = (shapes.corners[geoms] @ (way[:, None, None] @ turned).swapaxes(2, 3))[..., 0]
    along = along + (places @ way[:, :, None])
    return along[:, 1].min(1) - along[:, 0].max(1), closed


def _far(shapes: Shapes, look: mujoco.MjData) -> F64:
    """Return [J] how far a unit of each joint may move any colliding point or joint it carries."""
    reach = np.linalg.norm(look.geom_xpos[:, None] - look.xanchor, axis=2)
    reach = reach + shapes.wide.geom_rbound[:, None] + shapes.near
    reach = np.where(shapes.moved & shapes.meets[:, None], reach, 0.0).max(0)
    joints = np.linalg.norm(look.xanchor[:, None] - look.xanchor, axis=2) + shapes.near
    reach = np.maximum(reach, np.where(shapes.carried, joints, 0.0).max(0))
    return np.asarray(np.where(shapes.slide, 1.0, reach))
