"""Steps that leave out looking for contacts come to the numbers of the engine, bit by bit."""

from __future__ import annotations

from copy import copy
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from part2gs_robotics.assets import clear_steps
from part2gs_robotics.assets.clear_rooms import Rooms
from part2gs_robotics.assets.clear_steps import Stepper, same_rules, shapes_of

mujoco = pytest.importorskip("mujoco")


def wall(place: object, half: object, turn: str = "") -> str:
    """Return a box as MJCF writes it."""
    numbers = [" ".join(f"{v:.6g}" for v in np.asarray(a)) for a in (place, half)]
    return f'<geom type="box" pos="{numbers[0]}" size="{numbers[1]}" {turn}/>'


def pebble(rng: np.random.Generator, name: str) -> str:
    """Return a convex mesh as MJCF writes it."""
    points = rng.normal(size=(12, 3)) * 0.02
    hull = ConvexHull(points)
    outward = np.einsum("fi,fi->f", np.cross(points[hull.simplices[:, 1]] - points[hull.simplices[
        :, 0]], points[hull.simplices[:, 2]] - points[hull.simplices[:, 0]]), hull.equations[:, :3])
    faces = np.where(outward[:, None] > 0, hull.simplices, hull.simplices[:, ::-1])
    said = " ".join(f"{v:.6f}" for v in points.ravel()), " ".join(map(str, faces.ravel()))
    return f'<mesh name="{name}" vertex="{said[0]}" face="{said[1]}"/>'


def cabinet(seed: int, gap: float) -> mujoco.MjModel:
    """Return a case with a door on which a drawer rides, a lid, and bolts of odd shape.

    The door's drawer may meet its stop, the lid the door: rooms end where they do.
    """
    rng = np.random.default_rng(seed)
    turn = f'euler="{rng.uniform(-5, 5):.3f} {rng.uniform(-5, 5):.3f} 0"'
    case = [wall(p, h) for p, h in (((0, 0, -.3), (.3, .3, .01)), ((0, .3, 0), (.3, .01, .3)),
                                    ((.3, 0, 0), (.01, .3, .3)), ((-.3, 0, 0), (.01, .3, .3)))]
    door = [wall((x, 0, z), (.05, .01, .05), turn) for x in (.1, .2, .3) for z in (-.1, 0., .1)]
    tray = [wall((x, .04 + gap, .15), (.03, .02, .02)) for x in (.05, .12, .19)]
    lid = [wall((x, y, .02), (.1, .1, .01)) for x in (-.2, 0, .2) for y in (-.2, 0., .2)]
    stop = wall((.3, .04 + gap, .15), (.01, .02, .02))
    bolts = [pebble(rng, f"m{k}") for k in range(6)]
    geoms = "".join(f'<geom type="mesh" mesh="m{k}" pos="{.06 + .05 * k:.3f} {.08 + gap} -.1"/>'
                    for k in range(6))
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option integrator="implicitfast"><flag filterparent="disable"/></option>
      <asset>{''.join(bolts)}</asset><worldbody><body>{''.join(case)}
      <body name="door" pos="-.3 -.3 0"><joint name="door" axis="0 0 1" range="-2 .02"
        limited="true" damping=".1"/>{''.join(door)}{stop}
        <body name="tray"><joint name="tray" type="slide" axis="1 0 0" range="-.1 .2"
          limited="true" damping=".1"/>{''.join(tray)}{geoms}</body></body>
      <body name="lid" pos="0 .3 .33"><joint name="lid" axis="1 0 0" range="-1.5 .5"
        limited="true" damping=".1"/>{''.join(lid)}</body>
      </body></worldbody><actuator><position joint="door" kp="40" kv="4"/>
        <position joint="tray" kp="90" kv="9"/><position joint="lid" kp="40" kv="4"/></actuator>
      </mujoco>""")


def driven(model: mujoco.MjModel, seed: int, stepper: object) -> np.ndarray:
    """Return [S, 2 J] positions and speeds of a drive to random places."""
    rng, data = np.random.default_rng(seed), mujoco.MjData(model)
    step, out = stepper(data), []
    for _ in range(12):
        data.ctrl[:] = rng.uniform(model.jnt_range[:, 0], model.jnt_range[:, 1])
        for _ in range(30):
            step(4)
            out.append(np.concatenate([data.qpos, data.qvel]))
    return np.array(out)


@pytest.mark.parametrize("gap", [0.0005, 0.005])
def test_steps_are_those_of_the_engine_bit_by_bit(gap: float) -> None:
    left_out = 0
    for seed in range(4):
        model = cabinet(seed, gap)
        shapes = shapes_of(model)
        assert shapes is not None
        for drive in range(2):  # the second finds rooms of the first
            ours = driven(model, drive, lambda d, m=model, s=shapes: Stepper(s, m, d).step)
            theirs = driven(model, drive, lambda d, m=model: lambda n: mujoco.mj_step(m, d, n))
            assert np.array_equal(ours, theirs)
        left_out += shapes.rooms.count > 10
    assert left_out >= 3


def test_nothing_touches_in_a_room() -> None:
    rng = np.random.default_rng(0)
    tried = 0
    for seed in range(4):
        model = cabinet(seed, 0.002)
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MULTICCD)
        shapes, data = shapes_of(model), mujoco.MjData(model)
        assert shapes is not None
        driven(model, 0, lambda d, m=model, s=shapes: Stepper(s, m, d).step)
        for k in range(shapes.rooms.count):
            room = [a[k] for a in (shapes.rooms.origin, shapes.rooms.even, shapes.rooms.odd)]
            for _ in range(6):
                way = rng.normal(size=model.nv) * (rng.random(model.nv) < 0.7)
                used = room[1] @ np.abs(way) + room[2] @ way
                data.qpos[:] = room[0] + (0.999 / used * way if used > 0 else 0 * way)
                mujoco.mj_kinematics(model, data)
                mujoco.mj_collision(model, data)
                assert data.ncon == 0, (seed, k, way)
                tried += 1
    assert tried > 300


def test_rooms_end_short_of_what_touches_and_not_far_before() -> None:
    """A block slides towards another: the gap is known, and so is what a room may be."""
    geoms = "".join(wall((0.05 * (k % 4), 0.05 * (k // 4), 0), (.02, .02, .02)) for k in range(16))
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody><body>{geoms}</body>
      <body pos="0 0 .041"><joint type="slide" axis="0 0 1"/>{geoms}</body></worldbody></mujoco>""")
    shapes, data = shapes_of(model), mujoco.MjData(model)
    assert shapes is not None
    stepper = Stepper(shapes, model, data)
    model.opt.gravity[:] = 0
    stepper.step(1)
    _, even, odd = (a[0, 0] for a in (shapes.rooms.origin, shapes.rooms.even, shapes.rooms.odd))
    down, up = 1 / (even - odd), 1 / (even + odd)
    assert 0.85 * 0.001 < down < 0.001
    assert up == pytest.approx(0.9 * shapes.near)


def test_the_search_of_the_engine_is_not_believed() -> None:
    """Its distance may be too large where it stops early; gaps come from corners alone."""
    model = cabinet(1, 0.002)
    shapes = shapes_of(model)
    assert shapes is not None
    look = mujoco.MjData(shapes.wide)
    mujoco.mj_kinematics(shapes.wide, look)
    mujoco.mj_collision(shapes.wide, look)
    far = clear_steps._far(shapes, look)
    gaps = clear_steps._near(shapes, look, far)[0]
    found = np.array(look.contact.dist)
    assert len(gaps)
    assert (gaps <= found + 1e-6).all()
    for k in range(look.ncon):
        look.contact[k].dist *= 2
    assert np.array_equal(clear_steps._near(shapes, look, far)[0], gaps)


def test_what_touches_and_what_is_unknown_steps_as_ever() -> None:
    model = cabinet(0, 0.002)
    other = copy(model)
    other.geom_margin[3] = 0.01
    assert shapes_of(other) is None  # a margin
    other = copy(model)
    other.opt.integrator = int(mujoco.mjtIntegrator.mjINT_RK4)
    assert Stepper(shapes_of(model), other, mujoco.MjData(other)).shapes is None  # looks four times
    boxes = "".join(wall((k * .1, 0, 0), (.01, .01, .01)) for k in range(20))
    falling = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody><body><freejoint/>{boxes}</body></worldbody></mujoco>")
    assert shapes_of(falling) is None


def test_models_whose_shapes_meet_otherwise_share_no_rooms() -> None:
    model = cabinet(0, 0.002)
    assert same_rules(model, copy(model))
    for name, value in (("geom_contype", 0), ("geom_conaffinity", 2), ("geom_gap", 0.1)):
        other = copy(model)
        getattr(other, name)[3] = value
        assert not same_rules(model, other), name
    other = copy(model)
    other.opt.disableflags ^= int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
    assert not same_rules(model, other)


def test_rooms_are_found_by_where_the_joints_are() -> None:
    rooms = Rooms(2)
    assert rooms.around(np.zeros(2)) is None
    places = [np.array([0.0, 0.0]), np.array([1.0, 0.0]), np.array([1.0, 3.0])]
    for place in places:
        rooms.add((place, np.ones(2), np.zeros(2)))
    for place in places:
        found = rooms.around(place + 0.2)
        assert found is not None
        assert np.array_equal(found[0], place)
    assert rooms.around(np.array([0.5, 9.0])) is None
    assert rooms.around(np.array([np.nan, 0.0])) is None
    for one, two in pairwise(places):
        assert rooms.around((one + two) / 2) is None or np.abs(one - two).sum() < 1.6
