"""Scale: given, from a known length, or assumed; masses follow and the note says which."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synth import SIZE, WALL, toy_cabinet_twin

from part2gs_robotics.exporters.dynamics import physics_of
from part2gs_robotics.exporters.twin_yaml import twin_document
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.scale import ASSUMED, longest_side, with_scale
from part2gs_robotics.model.se3 import rotation_from_rotvec
from part2gs_robotics.model.twin import PartMesh, Twin


def turned(twin: Twin, rotvec: tuple[float, float, float]) -> Twin:
    """Return the twin in a world that is turned about the origin."""
    rot = rotation_from_rotvec(np.array(rotvec))

    def mesh(one: PartMesh) -> PartMesh:
        return replace(one, vertices=one.vertices @ rot.T)

    def joint(one: Joint | None) -> Joint | None:
        return one and replace(one, axis=rot @ one.axis, origin=rot @ one.origin)

    return replace(twin, parts=tuple(replace(p, mesh=mesh(p.mesh), joint=joint(p.joint))
                                     for p in twin.parts))


@pytest.mark.parametrize("rotvec", [(0, 0, 0), (0.3, -0.7, 1.1)])
def test_longest_side_is_that_of_the_object_not_of_its_world(
    rotvec: tuple[float, float, float],
) -> None:
    """The cabinet is 0.8 m high in either state, however its world is turned."""
    assert longest_side(turned(toy_cabinet_twin(2), rotvec)) == pytest.approx(SIZE[2], rel=1e-6)


def test_the_compact_state_is_measured() -> None:
    """A lid as long as the box is high, opened upwards in state 0: state 1 is the compact one."""
    cabinet = toy_cabinet_twin(1)
    drawer = cabinet.parts[1]
    assert drawer.joint is not None
    out = replace(cabinet, parts=(cabinet.parts[0], replace(
        drawer, joint=replace(drawer.joint, value=0.9), limits=(0, 0.9))))
    assert longest_side(out) == pytest.approx(SIZE[2], rel=1e-6)
    assert SIZE[0] + 0.9 - WALL > SIZE[2]


def test_known_length_gives_mass_and_gravity() -> None:
    """The toy cabinet is 0.8 units high; known to be 1.6 m it weighs eight times as much."""
    plain = replace(toy_cabinet_twin(2), meters_per_unit=None)
    twin = with_scale(plain, 1.6)
    assert twin.meters_per_unit == pytest.approx(2.0)
    assert twin.notes[-1].startswith("Scale: 1 unit = 2 m, 1.6 m over the longest side of 0.8 unit")
    one, two = physics_of(plain), physics_of(twin)
    assert two.masses[0].mass == pytest.approx(8 * one.masses[0].mass)
    np.testing.assert_allclose(two.gravity, (0, 0, -9.81 / 2), atol=1e-9)
    entry = twin_document(twin)["meters_per_unit"]
    assert entry == {"value": twin.meters_per_unit, "source": "measured", "note": twin.scale_note}


def test_assumed_and_given_scales_say_so() -> None:
    known = with_scale(toy_cabinet_twin(1), None)
    assert known.notes == ("Scale: 1 unit = 1 m, given; longest side 0.8 m.",)
    unknown = with_scale(replace(known, meters_per_unit=None, assumed_meters=1e-3, notes=()), None)
    assert unknown.meters_per_unit is None
    assert unknown.notes[0].startswith(f"{ASSUMED}: 1 unit = 0.001 m, so the longest side")


@pytest.mark.parametrize(("scale", "material", "source"), [
    (None, None, "assumed"), (1.0, None, "assumed"), (None, "steel", "assumed"),
    (1.0, "steel", "fitted")])
def test_mass_is_as_sure_as_scale_and_material(scale: float | None, material: str | None,
                                               source: str) -> None:
    twin = replace(toy_cabinet_twin(1), meters_per_unit=scale, material=material)
    document = twin_document(twin)
    assert document["parts"][0]["mass"]["source"] == source  # type: ignore[index]
    assert document["material"]["source"] == ("measured" if material else "assumed")  # type: ignore[index]
