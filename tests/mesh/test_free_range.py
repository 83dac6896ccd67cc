"""Ranges beyond the photographed states: stops in closed form, and what nothing is known of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synth import union_part

from part2gs_robotics.mesh import clearance
from part2gs_robotics.mesh.free_range import (
    INSIDE,
    MOST_TURN,
    TURN_BACK,
    with_free_ranges,
)
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.se3 import apply, screw_motion
from part2gs_robotics.model.solids import size_of, to_mesh
from part2gs_robotics.model.twin import Part, PartMesh, Twin

GREY = (120, 120, 120)
UP = np.array([0.0, 0, 1.0])


def door_twin(value=0.6, wall_angle=None, scale=1.0):
    """A door at x >= 0, hinged at the origin, in front of a cupboard; maybe a wall it runs into."""
    boxes = [((0.0, 0.02, 0.0), (1.0, 0.6, 1.0))]
    if wall_angle is not None:  # the door's thickness is 0.02; a wall whose face is at that angle
        boxes.append(((-1.0, -1.2, 0.0), (-0.9, 0.0, 1.0)))
    base = union_part("base", -1, boxes, None, (0.0, 0.0), GREY)
    joint = Joint("revolute", -UP, np.zeros(3), value)
    door = union_part("part_1", 0, [((0.01, -0.02, 0.0), (0.95, 0.0, 1.0))], joint, (0.0, value),
                      GREY)
    return scaled(Twin("toy", (base, door)), scale)


def scaled(twin, by):
    def mesh(m):
        return replace(m, vertices=by * m.vertices)

    def part(p):
        joint = p.joint and replace(p.joint, origin=by * p.joint.origin,
                                    value=p.joint.value * (1 if p.joint.turns else by))
        return replace(p, mesh=mesh(p.mesh), pieces=tuple(map(mesh, p.pieces)), joint=joint,
                       limits=(min(0.0, joint.value), max(0.0, joint.value)) if joint else (0, 0))

    return replace(twin, parts=tuple(map(part, twin.parts)))


def drawer_twin(depth, value=0.1):
    """A drawer of a length in a case of depth 0.5 with a back wall, open at x = 0.5."""
    case = [((0.0, 0.0, 0.0), (0.02, 0.4, 0.3)), ((0.02, 0.0, 0.0), (0.5, 0.02, 0.3)),
            ((0.02, 0.38, 0.0), (0.5, 0.4, 0.3)), ((0.02, 0.02, 0.0), (0.5, 0.38, 0.02))]
    base = union_part("base", -1, case, None, (0.0, 0.0), GREY)
    joint = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), value)
    box = [((0.49 - depth, 0.03, 0.03), (0.49, 0.37, 0.25))]
    return Twin("toy", (base, union_part("part_1", 0, box, joint, (0.0, value), GREY)))


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e3])
def test_a_door_closes_until_it_meets_the_front_whatever_the_unit(scale):
    part = with_free_ranges(door_twin(scale=scale)).parts[1]
    # The door's back, flush with the hinge line, is 0.02 before the front at its far edge.
    meets = -np.arcsin(0.02 / 0.95)
    assert part.limits_source == "derived"
    assert meets - 0.002 <= part.limits[0] <= meets + 2 * TURN_BACK + 0.002
    assert part.limits[1] == pytest.approx(part.limits[0] + MOST_TURN)


def test_a_wall_beside_the_hinge_stops_a_door():
    free = with_free_ranges(door_twin()).parts[1].limits
    stopped = with_free_ranges(door_twin(wall_angle=1)).parts[1].limits
    assert stopped[0] == pytest.approx(free[0], abs=TURN_BACK)
    # Turned by more than a right angle, the far edge at radius 0.95 reaches the wall at x = -0.9.
    meets = np.pi - np.arccos(0.9 / 0.95)
    assert meets - 0.05 < stopped[1] < meets


def test_what_nothing_stops_turns_by_half_a_turn_in_all():
    twin = door_twin()
    alone = Twin("toy", (replace(twin.parts[0], mesh=moved(twin.parts[0].mesh, [0, 9, 0])),
                         twin.parts[1]))
    low, high = with_free_ranges(alone).parts[1].limits
    assert high - low == pytest.approx(MOST_TURN)
    assert low == pytest.approx(-(high - 0.6)), "both ways alike where neither is known"


def moved(mesh, by):
    return PartMesh(mesh.vertices + np.array(by, float), mesh.faces, mesh.colors)


@pytest.mark.parametrize("depth", [0.2, 0.4])
def test_a_drawer_goes_in_to_the_back_wall_and_out_until_a_fifth_is_left(depth):
    low, high = with_free_ranges(drawer_twin(depth)).parts[1].limits
    back = -(0.49 - depth - 0.02)
    assert back <= low <= back + 0.003
    assert high == pytest.approx(0.5 - INSIDE * depth - (0.49 - depth), abs=1e-6)


def test_both_observed_states_stay_inside_and_contact_there_adds_nothing():
    twin = drawer_twin(0.4, value=-0.05)
    low, high = with_free_ranges(twin).parts[1].limits
    assert low <= -0.05
    assert high >= 0.0
    inside = Twin("toy", (twin.parts[0], replace(twin.parts[1], joint=replace(
        twin.parts[1].joint, value=-0.2))))  # seen deep in the back wall: nothing known beyond
    assert with_free_ranges(inside).parts[1].limits[0] == -0.2


def test_the_world_frame_does_not_matter():
    twin = door_twin(wall_angle=1)
    world = screw_motion(np.array([0.6, 0.0, 0.8]), np.array([1.0, 2, 3]), 0.7, 0.3)

    def placed(p):
        mesh = replace(p.mesh, vertices=apply(world, p.mesh.vertices))
        joint = p.joint and replace(p.joint, axis=world[:3, :3] @ p.joint.axis,
                                    origin=apply(world, p.joint.origin))
        return replace(p, mesh=mesh, joint=joint)

    there = with_free_ranges(replace(twin, parts=tuple(map(placed, twin.parts))))
    np.testing.assert_allclose(there.parts[1].limits, with_free_ranges(twin).parts[1].limits,
                               atol=TURN_BACK)


@pytest.mark.parametrize("extra", [0.0, 0.3])
def test_a_range_ends_where_pieces_cannot_be_parted(extra):
    """A block in the door's piece, not in its mesh, meets the wall beyond what was seen."""
    twin = with_free_ranges(door_twin())
    door = twin.parts[1]
    value, (_, high) = door.joint.value, door.limits
    stop = value + extra * (high - value)
    real = clearance._separated

    def stuck(t, gap):
        inside = stop < t.parts[1].limits[1]
        way = (stop, t.parts[1].limits[1])
        return real(t, gap)[0], [clearance._Stuck((0, 1), 1, way)] if inside else []

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(clearance, "_separated", stuck)
        kept = clearance.with_apart_pieces(twin)
    assert kept.parts[1].limits == (door.limits[0], stop)
    assert any("range ends where collision pieces would overlap" in note for note in kept.notes)
    assert clearance.with_apart_pieces(twin).parts[1].limits == twin.parts[1].limits


def crossing_twin(value, lifted=0.0):
    """Two slides over a plate, along x and along y, one lifted; their ways cross at the origin."""
    base = union_part("base", -1, [((-1.0, -1.0, -0.3), (1.0, 1.0, -0.2))], None, (0.0, 0.0), GREY)
    parts = [base]
    for k, axis in enumerate(np.eye(3)[:2]):
        low, high = np.full(3, -0.1), np.full(3, 0.1)
        low, high = low - 0.7 * axis + k * lifted * UP, high - 0.5 * axis + k * lifted * UP
        joint = Joint("prismatic", axis, np.zeros(3), value)
        parts.append(union_part(f"part_{k + 1}", 0, [(tuple(low), tuple(high))], joint,
                                (0.0, value), GREY))
    return Twin("toy", tuple(parts))


def test_no_two_joints_drive_their_parts_into_each_other():
    """Each slide alone passes the crossing; both at once would meet there."""
    ranges = [part.limits for part in with_free_ranges(crossing_twin(0.1)).parts[1:]]
    assert all(low < 0.0 and high >= 0.1 for low, high in ranges)
    # Tips stand 0.4 before the origin: one beyond 0.3 is in the way of the other beyond 0.3.
    assert min(high for _, high in ranges) <= 0.3 + 1e-3
    for k in (1, 2):  # either alone goes on
        twin = crossing_twin(0.1)
        alone = replace(twin, parts=(twin.parts[0], replace(twin.parts[k], name="part_1")))
        assert with_free_ranges(alone).parts[1].limits[1] > 0.9


@pytest.mark.parametrize(("film", "held"), [(0.001, False), (0.003, True)])
def test_a_film_of_noise_between_two_that_move_holds_neither_back(film, held):
    size = size_of(tuple(p.mesh for p in crossing_twin(0.1).parts))
    ranges = with_free_ranges(crossing_twin(0.1, 0.2 - film * size)).parts[1:]
    assert (min(part.limits[1] for part in ranges) < 0.9) == held


def test_what_meets_between_the_states_waits_and_keeps_its_range():
    twin = crossing_twin(0.9)
    alone = with_free_ranges(replace(twin, parts=twin.parts[:2])).parts[1].limits
    assert with_free_ranges(twin).parts[1].limits[1] >= min(0.9, alone[1])


NEAR = np.deg2rad(0.5)  # of a stop in closed form, beside the room that is left before it


def hung(base, boxes, axis, value=0.6):
    """A part of boxes that turns about an axis through the origin, beside a base of boxes."""
    joint = Joint("revolute", np.array(axis, float), np.zeros(3), value)
    return Twin("toy", (union_part("base", -1, base, None, (0.0, 0.0), GREY),
                        union_part("part_1", 0, boxes, joint, (0.0, value), GREY)))


@pytest.mark.parametrize("thick", [0.03, 0.06, 0.12])
def test_the_thick_edge_of_a_door_meets_the_front_beside_its_hinge(thick):
    gap = 0.01
    twin = hung([((-1.0, 0.0, 0.0), (1.0, 0.6, 1.0))],
                [((gap, -thick, 0.0), (0.9, -1e-3, 1.0))], -UP)
    stop = np.pi - np.arctan2(thick, gap)  # its corner comes round to the plane of the front
    assert with_free_ranges(twin).parts[1].limits[1] == pytest.approx(stop - TURN_BACK, abs=NEAR)


@pytest.mark.parametrize("away", [0.05, 0.3])
def test_a_lid_leans_against_the_wall_behind_it(away):
    thick, top = 0.04, 1.2
    box, wall = ((0.0, -1.0, -0.5), (1.0, 0.0, -1e-3)), ((0.0, away, -0.5), (1.0, away + 0.1, top))
    twin = hung([box, wall], [((0.0, -1.0, 0.0), (1.0, 0.0, thick))], (-1.0, 0.0, 0.0))
    far = np.hypot(1.0, thick)
    stop = np.pi - np.arccos(away / far) - np.arctan(thick)
    assert with_free_ranges(twin).parts[1].limits[1] == pytest.approx(stop - TURN_BACK, abs=NEAR)


def test_a_barrel_that_turns_in_its_socket_stops_nothing():
    import manifold3d

    thick, radius, hole = 0.04, 0.05, 0.0502
    ajar = screw_motion(UP, np.zeros(3), -0.6, 0.0)  # closed, its back lies flush with the front
    joint = Joint("revolute", UP, np.zeros(3), -0.6)
    solid = manifold3d.Manifold
    base = solid.cube([2.0, 0.6, 1.0]).translate([-1.0, 0.0, 0.0])
    door = solid.cube([0.88, thick, 1.0]).translate([0.02, -thick, 0.0])
    base -= solid.cylinder(1.0, hole, -1.0, 256)
    door += solid.cylinder(1.0, radius, -1.0, 256)
    twin = Twin("toy", (Part("base", -1, to_mesh(base), (), None),
                        Part("part_1", 0, to_mesh(door.transform(ajar[:3])), (), joint)))
    low, high = with_free_ranges(twin).parts[1].limits
    assert high == pytest.approx(0.6 - TURN_BACK, abs=NEAR)
    # Opened, its front comes round to the plane beside the socket, whose corner it meets first.
    stop = np.pi - np.arcsin(thick / hole)
    assert low == pytest.approx(0.6 - stop + TURN_BACK, abs=2 * NEAR), "within simpler copies"


def test_two_stops_that_are_farther_apart_than_half_a_turn_both_count():
    blade = [((0.2, -0.01, 0.0), (1.0, 0.01, 0.3))]
    pillars = [((-0.1, -0.7, 0.0), (0.0, -0.5, 0.3)), ((-0.7, -0.1, 0.0), (-0.5, 0.0, 0.3)),
               ((-0.1, -0.1, -0.1), (0.1, 0.1, -0.05))]
    low, high = with_free_ranges(hung(pillars, blade, UP, 0.3)).parts[1].limits
    edge = np.arcsin(0.01 / 0.5)  # half the blade's thickness at the nearer edge of a pillar
    assert low == pytest.approx(-np.pi / 2 + edge + TURN_BACK, abs=NEAR)
    assert high == pytest.approx(np.pi - edge - TURN_BACK, abs=NEAR)


def test_a_fin_thinner_than_contact_stops_a_door_that_it_would_stick_deep_in():
    """A blade of 0.4 mm stands in the door's way: of no thickness, but as deep as the door."""
    free = door_twin()
    boxes = [((0.0, 0.02, 0.0), (1.0, 0.6, 1.0)), ((-0.0004, -0.4, 0.0), (0.0, -0.2, 1.0))]
    fin = union_part("base", -1, boxes, None, (0.0, 0.0), GREY)
    found = with_free_ranges(replace(free, parts=(fin, free.parts[1])))
    meets = np.pi / 2 - np.arcsin(0.02 / 0.2)  # the door's back, at the blade's near end
    assert meets - 0.04 < found.parts[1].limits[1] < meets
    assert with_free_ranges(free).parts[1].limits[1] > 2.0
