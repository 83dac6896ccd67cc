"""A part in two bodies is told of: it may be two parts that move nearly alike."""

from __future__ import annotations

from dataclasses import replace

import pytest
from synth import box, toy_cabinet_twin

from part2gs_robotics.mesh.real_parts import two_bodies
from part2gs_robotics.model.solids import to_mesh

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
