"""Every term on a joint: its gradient, its two forms, and a switch that changes the result."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.se3 import apply
from part2gs_robotics.paper.joint_terms import PHYS_WEIGHT, TERMS, Pull, parts_of, terms_on
from part2gs_robotics.paper.pull import physical_steps

pytestmark = pytest.mark.usefixtures("one_torch_thread")

FORMS = pytest.mark.parametrize("paper", [False, True])
DOOR = Joint("revolute", np.array([0.0, 0, 1]), np.array([0.0, 0, 0]), 0.8)
OFF = ArticulateConfig(**dict.fromkeys(TERMS, False))
ALL = ArticulateConfig(**dict.fromkeys(TERMS, True))


def sheet(origin, u, v, step=0.0625):
    a, b = np.meshgrid(np.arange(0, 1, step), np.arange(0, 1, step), indexing="ij")
    points = np.array(origin) + a.reshape(-1, 1) * np.array(u) + b.reshape(-1, 1) * np.array(v)
    normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
    n = len(points)
    return Surfels(points, np.tile(normal, (n, 1)), np.full((n, 3), 0.5), np.full(n, 5))


@pytest.fixture(scope="module")
def study():
    """A floor, and a door above it that turns by 0.8 rad; the floor meets the door in state 0."""
    floor = sheet((-0.2, -0.2, 0), (1, 0, 0), (0, 1, 0))
    shut = sheet((0.02, 0, 0.005), (0.6, 0, 0), (0, 0.05, 0.7))
    opened = replace(shut, points=apply(DOOR.transform(DOOR.value), shut.points))
    states = tuple(Surfels(*(np.concatenate([getattr(s, f) for s in (floor, door)])
                             for f in ("points", "normals", "colors", "views")))
                   for door in (shut, opened))
    hard = np.concatenate([np.repeat([0, 1], [len(floor.points), len(shut.points)])] * 2)
    return SimpleNamespace(surfels=states, diag=1.5, tau=0.02, hard=hard)


@pytest.fixture(scope="module")
def parts(study):
    return {paper: parts_of(study, study.hard, 1, paper)[0] for paper in (False, True)}


def near():
    """A door that is some degrees and a hundredth off, and dips into the floor."""
    axis = np.array([0.03, 0.06, 1.0])
    return replace(DOOR, axis=axis / np.linalg.norm(axis), origin=np.array([0.011, -0.007, 0]),
                   value=0.79)


def numbers(joint):
    return tuple(torch.tensor(x, dtype=torch.float64, requires_grad=True)
                 for x in (joint.axis, joint.origin, joint.value))


def only(*names, paper=False):
    return replace(OFF, paper_mode=paper, **dict.fromkeys(names, True))


@pytest.mark.parametrize(("name", "paper"), [(n, p) for n in TERMS for p in (False, True)
                                             if (n, p) != ("repel", True)])
def test_gradients_agree_with_differences(parts, name, paper):
    """Matching and the printed push are constant in the gradient; the latter has its own test."""
    pull = Pull(parts[paper], near(), only(name, paper=paper))
    assert pull(*numbers(near())).item() > 0
    assert torch.autograd.gradcheck(pull, numbers(near()), eps=1e-7, atol=1e-6, rtol=1e-5)


@FORMS
@pytest.mark.parametrize("name", TERMS)
def test_every_switch_changes_loss_gradient_and_joint(study, parts, name, paper):
    everything = replace(ALL, paper_mode=paper)
    without = replace(everything, **{name: False})
    losses, slopes = [], []
    for config in (everything, without):
        at = numbers(near())
        value = Pull(parts[paper], near(), config)(*at)
        value.backward()
        losses.append(value.item())
        slopes.append(np.concatenate([x.grad.numpy().ravel() for x in at]))
    assert abs(losses[0] - losses[1]) > 1e-9
    assert np.abs(slopes[0] - slopes[1]).max() > 1e-9
    (one,), (two,) = (physical_steps(study, [near()], study.hard, c) for c in (everything, without))
    assert np.abs(np.append(one.axis - two.axis, one.value - two.value)).max() > 1e-7


def test_no_term_means_the_same_joints(study):
    joints = [near()]
    assert physical_steps(study, joints, study.hard, OFF) is joints
    assert terms_on(OFF) == ()
    assert terms_on(ArticulateConfig()) == ("vector_field", "contact")


def test_the_default_is_vector_field_plus_a_tenth_of_contact(parts):
    pull = Pull(parts[False], near(), ArticulateConfig())
    values = {name: loss.item() for name, loss in pull.values(*numbers(near())).items()}
    assert PHYS_WEIGHT == 0.1
    assert pull(*numbers(near())).item() == pytest.approx(
        values["vector_field"] + 0.1 * values["contact"], rel=1e-14)


def test_every_corrected_term_but_repel_is_zero_at_the_truth(parts):
    values = Pull(parts[False], DOOR, ALL).values(*numbers(DOOR))
    for name in set(TERMS) - {"repel"}:
        assert values[name].item() == pytest.approx(0.0, abs=1e-10), name
    assert values["repel"].item() > 0


def test_the_printed_velocity_term_shuts_a_true_door_and_the_corrected_one_does_not(parts):
    slopes = []
    for paper in (True, False):
        at = numbers(DOOR)
        Pull(parts[paper], DOOR, only("velocity", paper=paper))(*at).backward()
        slopes.append(at[2].grad.item())
    zero = parts[True].zero[:, :2] / parts[True].diag  # the turn leaves z
    spread = np.square(zero - zero.mean(0)).sum(1).mean()
    # d/dq of 4 sin^2(q / 2) spread is 2 sin(q) spread
    assert slopes[0] == pytest.approx(PHYS_WEIGHT * 2 * np.sin(DOOR.value) * spread, rel=1e-9)
    assert slopes[1] == pytest.approx(0.0, abs=1e-9)


def test_printed_vector_field_is_the_sum_over_the_pairs_of_eq_2(parts):
    part = parts[True]
    pull = Pull(part, near(), only("vector_field", paper=True))
    first, second = part.pairs
    there = apply(near().transform(near().value), first)
    expected = PHYS_WEIGHT * np.square((there - second) / part.diag).sum()
    assert len(first) > 20
    assert pull(*numbers(near())).item() == pytest.approx(expected, rel=1e-9)


def test_corrected_repel_points_lift_a_drawer_off_its_seam_and_printed_ones_pull_it_in():
    """A lid on a slide above the floor: which way does the gradient drive it?"""
    floor = sheet((0, 0, 0), (1, 0, 0), (0, 1, 0))
    low = sheet((0.2, 0.2, 0.03), (0.5, 0, 0), (0, 0.4, 0))
    lid = Joint("prismatic", np.array([0.0, 0, 1]), np.zeros(3), 0.1)
    high = replace(low, points=low.points + np.array([0, 0, 0.1]))
    states = tuple(Surfels(*(np.concatenate([getattr(s, f) for s in (floor, moved)])
                             for f in ("points", "normals", "colors", "views")))
                   for moved in (low, high))
    hard = np.concatenate([np.repeat([0, 1], [len(floor.points), len(low.points)])] * 2)
    toy = SimpleNamespace(surfels=states, diag=1.5, tau=0.02)
    part, = parts_of(toy, hard, 1, True)
    at = numbers(lid)
    Pull(part, lid, only("repel"))(*at).backward()
    assert at[2].grad.item() < 0  # descent makes the slide longer
    at = numbers(lid)
    Pull(part, lid, only("repel", "vector_field", paper=True))(*at).backward()
    plain = numbers(lid)
    Pull(part, lid, only("vector_field", paper=True))(*plain).backward()
    # Points drawn to the seam are carried back by a longer slide: attraction shows as its excess.
    assert at[2].grad.item() < plain[2].grad.item()


@FORMS
def test_steps_without_a_seam_or_pairs_stay_finite(study, paper):
    alone = np.ones_like(study.hard)
    joint, = physical_steps(study, [near()], alone, replace(ALL, paper_mode=paper))
    assert np.isfinite([*joint.axis, *joint.origin, joint.value]).all()
