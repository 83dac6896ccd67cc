"""Parts that moved alike: their bodies part them where photos cannot, or they are told of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from chest_room import two_states
from synth import box, toy_cabinet_twin

from part2gs_robotics.config import MeshConfig
from part2gs_robotics.mesh.bodies import _bodies, parted, two_bodies
from part2gs_robotics.mesh.real_parts import build_existing
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.solids import to_mesh

BODY = (np.array([-0.3, -0.25, -0.2]), np.array([0.0, 0.25, 0.2]))
UPPER = (np.array([0.0, -0.2, 0.03]), np.array([0.15, 0.2, 0.18]))
LOWER = (np.array([0.0, -0.2, -0.18]), np.array([0.15, 0.2, -0.03]))
KNOB = (np.array([0.17, -0.02, 0.08]), np.array([0.2, 0.02, 0.12]))  # a gap before the upper one
SLIDE = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.1)
FRONT = box((0.5, 0.0, 0.0), (0.52, 0.4, 0.2))


def parts_with(*bodies):
    """Return a base and a part of these bodies."""
    solid = bodies[0]
    for body in bodies[1:]:
        solid += body
    base, part = toy_cabinet_twin(1).parts
    return base, replace(part, mesh=to_mesh(solid))


def test_one_body_and_a_handle_of_its_own_are_no_news() -> None:
    handle = box((0.54, 0.15, 0.09), (0.55, 0.25, 0.11))  # a gap before the front
    assert two_bodies(parts_with(FRONT)) == []
    assert two_bodies(parts_with(FRONT, handle)) == []


@pytest.mark.parametrize(("high", "shares"), [(0.2, "50% and 50%"), (0.1, "67% and 33%")])
def test_two_fronts_in_one_part_are_told_of(high, shares) -> None:
    note, = two_bodies(parts_with(FRONT, box((0.5, 0.0, 0.3), (0.52, 0.4, 0.3 + high))))
    assert note.startswith("part_1 is two bodies or more")
    assert shares in note
    assert "--parts" in note


def test_the_base_may_be_in_pieces() -> None:
    base, part = parts_with(FRONT)
    apart = to_mesh(FRONT + box((0.5, 0.0, 0.3), (0.52, 0.4, 0.5)))
    assert two_bodies((replace(base, mesh=apart), part)) == []


def alike(*boxes):
    """Return (scene, gaussians, motion) of boxes that slide off a body together, as one part."""
    scene, gaussians, motion = two_states([BODY, *boxes], [SLIDE] * len(boxes))
    probs = [np.stack([p[:, 0], p[:, 1:].sum(1)], 1) for p in motion.part_probs]
    one = replace(motion, part_probs=(probs[0], probs[1]), joints=motion.joints[:1], parents=(0,),
                  diagnostics=motion.diagnostics[:1])
    return scene, gaussians, one, motion


def test_two_drawers_pulled_out_alike_are_two_parts():
    scene, gaussians, one, both = alike(UPPER, LOWER)
    found, parts = build_existing(scene, gaussians, one, MeshConfig(resolution=40))
    assert [part.name for part in parts] == ["base", "part_1", "part_2"]
    assert found.joints == (one.joints[0], one.joints[0])
    heights = sorted(np.ptp(part.mesh.vertices[:, 2]) / 2 + part.mesh.vertices[:, 2].min()
                     for part in parts[1:])
    assert heights == pytest.approx([-0.105, 0.105], abs=0.02)
    for state in (0, 1):  # each Gaussian with its own drawer, whichever of the two is the first
        true, new = both.labels(state), found.labels(state)
        assert len({(int(a), int(b)) for a, b in zip(true, new, strict=True)}) == 3
    assert [note for note in found.notes if "part_1 and part_2 moved alike" in note]
    assert all(np.isnan(row["prices_saved"]) for row in found.diagnostics)
    assert not [note for note in found.notes if "two bodies" in note]


def test_a_drawers_back_goes_with_its_front_though_no_floor_was_seen():
    front, back = (0.0, -0.2, 0.03), (0.1, -0.18, 0.05)
    _, part = parts_with(box(front, (0.05, 0.2, 0.18)), box(back, (0.14, 0.18, 0.16)))
    assert len(_bodies(part.mesh, SLIDE)) == 1
    upwards = replace(SLIDE, axis=np.array([0.0, 0.0, 1.0]))
    assert len(_bodies(part.mesh, upwards)) == 2


def test_two_that_turn_alike_stay_one():
    scene, gaussians, one, _ = alike(UPPER, LOWER)
    hinge = Joint("revolute", np.array([0.0, 0.0, 1.0]), np.array([0.0, -0.2, 0.0]), 0.5)
    turning = replace(one, joints=(hinge,))
    assert parted(scene, gaussians, turning, parts_with(box(*UPPER), box(*LOWER))) is turning


def test_two_walls_of_one_drawer_are_no_drawers_and_are_told_of():
    scene, gaussians, one, _ = alike(UPPER, LOWER)
    walls = [box((0.0, y, 0.0), (0.15, y + 0.02, 0.18)) for y in (-0.2, 0.18)]
    parts = parts_with(*walls)
    assert len(_bodies(parts[1].mesh, SLIDE)) == 2
    assert parted(scene, gaussians, one, parts) is one
    assert len(two_bodies(parts)) == 1


def test_a_knob_before_its_drawer_is_no_part():
    scene, gaussians, one, _ = alike(UPPER, KNOB)
    found, parts = build_existing(scene, gaussians, one, MeshConfig(resolution=40))
    assert len(parts) == 2
    assert found.joints == one.joints


@pytest.mark.parametrize(("asked", "parts"), [(1, 1), (2, 2), (3, 2), (None, 2)])
def test_a_number_of_parts_that_was_given_is_kept_to(asked, parts):
    scene, gaussians, one, _ = alike(UPPER, LOWER)
    base, part = parts_with(box(*UPPER), box(*LOWER))
    assert len(parted(scene, gaussians, one, (base, part), asked).joints) == parts


@pytest.mark.parametrize("home", [UPPER, LOWER])
def test_what_a_part_carries_stays_on_the_body_that_it_hangs_at(home):
    boxes = [BODY, UPPER, LOWER, KNOB]
    scene, gaussians, motion = two_states(boxes, [SLIDE] * 3, parents=(0, 0, 1))
    probs = [np.stack([p[:, 0], p[:, 1:3].sum(1), p[:, 3]], 1) for p in motion.part_probs]
    one = replace(motion, part_probs=(probs[0], probs[1]), joints=motion.joints[:2], parents=(0, 1),
                  diagnostics=motion.diagnostics[:2])
    base, part = parts_with(box(*UPPER), box(*LOWER))
    middle = (home[0] + home[1]) / 2
    knob = replace(part, name="part_2", mesh=to_mesh(box(middle - 0.01, middle + 0.01)))
    more = parted(scene, gaussians, one, (base, part, knob))
    assert more.parents == (0, 1, 0)
    own = np.concatenate([gaussians[0].means[more.labels(0) == 1]])
    assert (own[:, 2].mean() > 0) == (home is UPPER)
