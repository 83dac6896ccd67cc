"""The canonical room: what it refuses, equally bright states, and the state richer in motion."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.errors import FitError
from part2gs_robotics.evidence import canonical as room
from part2gs_robotics.evidence.canonical import canonical
from part2gs_robotics.evidence.exposure import gain_between
from part2gs_robotics.model.gaussians import SH_C0, Gaussians
from part2gs_robotics.model.se3 import screw_motion

SIDE = 96
MADE_WHEN_ASKED = "seen", "surfaces"


@pytest.fixture(scope="module")
def door(toy):
    """A door, closed in state 0 and opened in state 1: a scene, and Gaussians of both states."""
    base = toy.Box((0, 0, 0), (0.8, 0.6, 0.5), 1)
    closed = toy.Box((0, -0.09, 0), (0.8, -0.06, 0.5), 2)
    turn = screw_motion(np.array([0.0, 0, 1]), np.array([0, -0.09, 0]), -1.5, 0.0)
    pair = [toy.gaussians_of([base, one], 0.035)[0] for one in (closed, replace(closed, move=turn))]
    eyes = toy.cameras(24, SIDE, np.array([0.4, 0.0, 0.25]), 1.3)
    return toy.scene_of(tuple(toy.drawn(g, *eyes, SIDE) for g in pair)), (pair[0], pair[1])


@pytest.fixture(scope="module")
def both(door):
    return canonical(*door)


def broken(gaussians, index):
    means = gaussians.means.copy()
    means[index] = np.nan
    return replace(gaussians, means=means)


def dimmed(scene, pair, state, gain):
    """Return the same as seen by a camera that takes one state darker."""
    views = list(scene.states)
    images = np.round(views[state].images * gain).astype(np.uint8)
    views[state] = replace(views[state], images=images)
    new = list(pair)
    sh0 = ((new[state].colors * gain - 0.5) / SH_C0).astype(np.float32)
    new[state] = replace(new[state], sh0=sh0)
    return replace(scene, states=tuple(views)), tuple(new)


def with_buried(gaussians):
    """Return Gaussians with forty more, opaque, deep inside the base."""
    inside = np.linspace((0.2, 0.5, 0.1), (0.6, 0.55, 0.4), 40).astype(np.float32)
    copies = gaussians.select(np.arange(40))
    copies = replace(copies, means=inside, logit_opacities=np.full(40, 4.0, np.float32))
    names = ("means", "quats", "log_scales", "logit_opacities", "sh0", "shN")
    return Gaussians(*(np.concatenate([getattr(g, n) for g in (gaussians, copies)])
                       for n in names))


def test_an_empty_or_broken_state_is_refused(door):
    scene, (good, other) = door
    empty = good.select(np.zeros(0, np.int64))
    with pytest.raises(FitError, match=r"^state 1: the fit holds 0 Gaussians, so no motion can be "
                                       r"measured\. At least 1 was expected; check that"):
        canonical(scene, (good, empty))
    with pytest.raises(FitError, match=r"^state 0: the fit holds 0 Gaussians.*check"):
        canonical(scene, (empty, good))
    count = len(good)
    with pytest.raises(FitError, match=rf"^state 0: 1 of {count} Gaussians have NaN or infinite "
                                       r"centres\. Finite centres were expected; fit this state"):
        canonical(scene, (broken(good, 3), other))
    with pytest.raises(FitError, match=rf"^state 1: 2 of {len(other)} Gaussians have NaN"):
        canonical(scene, (good, broken(other, [0, 7])))
    endless = replace(good, means=np.where(good.means > 0.7, np.inf, good.means))
    with pytest.raises(FitError, match=r"^state 0: \d+ of .* NaN or infinite"):
        canonical(scene, (endless, other))


def test_states_alike_in_brightness_are_left_as_they_are(door, both):
    scene, pair = door
    assert both.scene is scene
    assert both.gaussians is pair
    assert both.exposure == ""


@pytest.mark.parametrize("state", [0, 1])
@pytest.mark.parametrize("gain", [np.full(3, 0.7), np.array([0.9, 0.75, 0.6])])
def test_a_darker_state_comes_out_as_bright_as_the_other(door, caplog, state, gain):
    scene, pair = door
    with caplog.at_level(logging.INFO):
        even = canonical(*dimmed(scene, pair, state, gain))
    assert "brightened" in even.exposure
    assert even.exposure in caplog.messages
    assert gain_between(even.scene, even.gaussians) == pytest.approx(np.ones(3), abs=0.03)
    other = 1 - state
    assert np.array_equal(even.scene.states[other].images, scene.states[other].images)
    assert even.gaussians[other].colors == pytest.approx(pair[other].colors, abs=1e-6)
    assert even.gaussians[state].colors == pytest.approx(pair[state].colors, abs=0.03)
    # 8-bit steps of a darker photo are larger; the gain is known to two per cent
    apart = np.abs(even.scene.states[state].images.astype(int) - scene.states[state].images)
    assert np.median(apart[scene.states[state].alphas == 255]) <= 3
    assert (even.gaussians[state].means == pair[state].means).all()


def test_what_no_photo_shows_is_clear_in_seen_alone(door):
    scene, (zero, one) = door
    more = with_buried(zero)
    got = canonical(scene, (more, one))
    assert [len(g) for g in got.seen] == [len(more), len(one)]
    assert got.seen[0].opacities[-40:].max() < 1e-6
    assert np.array_equal(got.gaussians[0].opacities, more.opacities)
    on_top = zero.means[:, 2] > 0.499
    assert on_top.sum() > 100
    assert np.array_equal(got.seen[0].opacities[:-40][on_top], zero.opacities[on_top])
    for name in ("means", "quats", "log_scales", "sh0"):
        assert np.array_equal(getattr(got.seen[0], name), getattr(more, name))


def test_weights_add_up_and_favour_the_opened_state(both):
    zero, one = both.weights
    assert zero + one == 1.0
    assert 0.52 < one <= 1.0
    assert both.told == f"state 1 richer in motion, weight of state 0 {zero:.2f}"
    evidence = both.surfaces.evidence
    assert len(evidence.arrived) > len(evidence.vacated)
    assert evidence.weights == both.weights


def test_swapping_the_states_swaps_the_weights(door, both):
    scene, (zero, one) = door
    swapped = canonical(replace(scene, states=scene.states[::-1]), (one, zero))
    assert swapped.weights == pytest.approx(both.weights[::-1], abs=1e-12)
    assert swapped.told.startswith("state 0 richer")
    assert len(swapped.surfaces.evidence.vacated) == len(both.surfaces.evidence.arrived)


def test_nothing_is_computed_that_nobody_asked_for(door, monkeypatch):
    calls = []

    def counted(name):
        true = getattr(room, name)

        def call(*args):
            calls.append(name)
            return true(*args)

        monkeypatch.setattr(room, name, call)

    counted("surfaces_of")
    counted("without_unseen")
    both = canonical(*door)
    assert not calls
    assert not set(vars(both)) & set(MADE_WHEN_ASKED)
    for _ in range(2):
        both.weights, both.told, both.surfaces  # noqa: B018
    assert calls == ["surfaces_of"]
    for _ in range(2):
        both.seen  # noqa: B018
    assert calls == ["surfaces_of", "without_unseen", "without_unseen"]
