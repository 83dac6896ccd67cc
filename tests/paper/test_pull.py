"""Physical terms stay finite whatever is missing, and keep a true joint true."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.paper.joint_terms import Base
from part2gs_robotics.paper.pull import part_diagnostics, physical_steps

DIAG, TAU = 1.5, 0.02


def sheet(origin, u, v, normal, step=0.03):
    a, b = np.meshgrid(np.arange(0, 1, step), np.arange(0, 1, step), indexing="ij")
    points = np.array(origin) + a.reshape(-1, 1) * np.array(u) + b.reshape(-1, 1) * np.array(v)
    n = len(points)
    return Surfels(points, np.tile(np.array(normal, float), (n, 1)), np.full((n, 3), 0.5),
                   np.full(n, 5))


def join(*sets):
    return Surfels(*(np.concatenate([getattr(s, f) for s in sets])
                     for f in ("points", "normals", "colors", "views")))


JOINT = Joint("prismatic", np.array([0.0, 0, 1]), np.zeros(3), 0.3)


def study_of(moved=0.3):
    """A floor, and a smaller sheet above it that rises; surfels and labels of both states."""
    floor = sheet((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    low = sheet((0.2, 0.2, 0.05), (0.5, 0, 0), (0, 0.4, 0.1), (0, 0, -1))
    high = Surfels(low.points + np.array([0, 0, moved]), low.normals, low.colors, low.views)
    states = join(floor, low), join(floor, high)
    hard = np.concatenate([np.repeat([0, 1], [len(floor), len(low)])] * 2)
    return SimpleNamespace(surfels=states, diag=DIAG, tau=TAU), hard


@pytest.mark.parametrize("paper", [False, True])
def test_all_terms_of_a_plain_part_are_finite_and_small_at_the_truth(paper):
    study, hard = study_of()
    (row,), _ = part_diagnostics(study, [JOINT], hard, paper)
    assert np.isfinite(list(row.values())).all()
    assert row["motion_residual"] < 1e-9
    assert row["velocity_loss"] == pytest.approx(0.0, abs=1e-9)
    assert row["vector_field_loss"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("paper", [False, True])
def test_an_empty_base_is_touched_by_nothing(paper):
    study, hard = study_of()
    alone = np.ones_like(hard)
    (row,), notes = part_diagnostics(study, [JOINT], alone, paper)
    assert row["contact_loss"] == 0.0
    assert row["repel_points"] == 0.0
    assert np.isfinite(list(row.values())).all()
    assert notes == ("part_1: no seam within reach of the base, repel points left out",)
    joint, = physical_steps(study, [JOINT], alone, ArticulateConfig(paper_mode=paper))
    assert np.isfinite([*joint.axis, *joint.origin, joint.value]).all()


@pytest.mark.parametrize("paper", [False, True])
@pytest.mark.parametrize("gone", ["both", "state 0", "state 1"])
def test_a_part_without_points_keeps_its_joint(gone, paper):
    study, hard = study_of()
    n0 = len(study.surfels[0])
    hard[:n0] *= gone == "state 1"
    hard[n0:] *= gone == "state 0"
    joint, = physical_steps(study, [JOINT], hard, ArticulateConfig(paper_mode=paper))
    assert joint == JOINT
    (row,), _ = part_diagnostics(study, [JOINT], hard, paper)
    assert np.isnan(row["motion_residual"])


def test_steps_lower_the_misfit_of_a_joint_that_is_off():
    from dataclasses import replace

    study, hard = study_of()
    off = replace(JOINT, value=0.29)
    joint, = physical_steps(study, [off], hard, ArticulateConfig())
    assert abs(joint.value - 0.3) < 0.5 * abs(off.value - 0.3)
    assert np.linalg.norm(joint.axis) == pytest.approx(1.0)


def test_the_distance_to_the_base_is_signed_along_its_normals():
    floor = sheet((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    base = Base(floor.points, floor.normals, 1.0)
    points = torch.tensor([[0.5, 0.5, 0.2], [0.5, 0.5, -0.2], [9.0, 0.5, -0.01]]).double()
    assert base(points).tolist() == pytest.approx([0.2, -0.2, 0.01])  # far beside it: free
    empty = Base(np.zeros((0, 3)), np.zeros((0, 3)), 1.0)
    assert torch.isinf(empty(points)).all()
