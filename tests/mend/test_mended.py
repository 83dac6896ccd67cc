"""Mending: planted overlaps go, in few rounds, and what is sound or truly crosses stays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from synth import lumpy_cabinet, toy_cabinet_twin, union_part

from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.mend import mendable, mended
from part2gs_robotics.mend.carve import MOST, carved
from part2gs_robotics.mend.evidence import Evidence
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.solids import to_manifold, watertight
from part2gs_robotics.model.twin import Twin
from part2gs_robotics.sim_checks import check
from part2gs_robotics.sim_checks.result import CheckReport


def checked(twin: Twin, folder: Path) -> CheckReport:
    folder.mkdir()
    write_mjcf(twin, folder)
    return check(folder, only=("overlap",))


def test_a_planted_overlap_is_carved_away_and_told(tmp_path: Path) -> None:
    twin = lumpy_cabinet(0.008)
    done, rounds = mended(twin)
    after = checked(done, tmp_path / "after")
    assert not mendable(after)
    notes = [note for note, seconds in rounds if seconds > 0]
    assert 1 <= len(notes) == len(rounds) <= 3
    assert "round 1: parts overlapped by 0.7" in notes[0]
    assert "left nothing beyond what is allowed" in notes[-1]
    assert all(watertight(part.mesh) for part in done.parts)
    assert done.parts[1] is twin.parts[1], "the base yields"
    lost = [1 - to_manifold(b.mesh).volume() / to_manifold(a.mesh).volume()
            for a, b in zip(twin.parts, done.parts, strict=True)]
    assert 0 < lost[0] < 0.001
    assert [j.joint for j in done.parts] == [j.joint for j in twin.parts]


def test_a_sound_twin_comes_back_as_it_is() -> None:
    twin = toy_cabinet_twin(1)
    done, rounds = mended(twin)
    assert done.parts == twin.parts
    assert rounds == ()


def test_what_overlaps_as_written_is_carved_though_it_does_not_here(tmp_path: Path) -> None:
    """The sliver of two faces that touch is as deep as rounding to the scene's units makes it."""
    here, written = lumpy_cabinet(0.0015), checked(lumpy_cabinet(0.004), tmp_path / "written")
    assert mendable(written)
    assert not mendable(checked(here, tmp_path / "here"))
    assert mended(here)[1] == ()
    done, rounds = mended(here, written)
    assert len(rounds) == 1
    assert "left nothing beyond what is allowed" in rounds[0][0]
    lost = 1 - to_manifold(done.parts[0].mesh).volume() / to_manifold(here.parts[0].mesh).volume()
    assert 0 < lost < 0.001


def test_parts_that_truly_cross_are_left_alone() -> None:
    """A drive straight through a wall is a wrong joint: no carving makes it right."""
    joint = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.5)
    base = union_part("base", -1, [((0, 0, 0), (1, 1, 0.1)), ((0.5, 0, 0.1), (0.6, 1, 0.6))], None,
                      (0, 0), (9, 9, 9))
    slide = union_part("part_1", 0, [((0.1, 0.2, 0.11), (0.3, 0.8, 0.4))], joint, (0, 0.5),
                       (9, 9, 9))
    twin = Twin("wall", (base, slide), 1.0, np.array([0.0, 0, 1]))
    done, rounds = mended(twin)
    assert not any("left nothing" in note for note, _ in rounds)
    lost = 1 - to_manifold(done.parts[0].mesh).volume() / to_manifold(base.mesh).volume()
    assert lost <= 3 * MOST


@pytest.mark.parametrize("late", [False, True])
def test_evidence_is_carved_in_the_frame_of_what_yields(late: bool) -> None:
    """Of two that move the larger one yields, at its own place."""
    joint = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.5)
    small = union_part("a", 0, [((0, 0, 0.2), (0.1, 0.1, 0.301))], joint, (0, 0.5), (9, 9, 9))
    large = union_part("b", 0, [((0, 0, 0.3), (1, 1, 0.6))], joint, (0, 0.5), (9, 9, 9))
    base = union_part("base", -1, [((0, 0, 0), (1, 1, 0.1))], None, (0, 0), (9, 9, 9))
    twin = Twin("two", (base, large, small) if late else (base, small, large), 1.0)
    done = carved(twin, [Evidence((0.2, 0.2), (1, 2), 0.001)])
    index = 1 if late else 2
    assert [a is b for a, b in zip(done.parts, twin.parts, strict=True)] == [
        i != index for i in range(3)]
    cut = to_manifold(done.parts[index].mesh)
    assert (cut ^ to_manifold(small.mesh)).volume() == 0
    assert cut.volume() == pytest.approx(0.3, rel=1e-3)


def test_a_part_that_nothing_overlaps_is_the_same_part() -> None:
    """Or its mesh was made anew, and its texture is gone for nothing."""
    twin = toy_cabinet_twin(1)
    done = carved(twin, [Evidence((0.0,), (0, 1), 0.001)])
    assert all(a is b for a, b in zip(done.parts, twin.parts, strict=True))
