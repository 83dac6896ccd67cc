"""Gaussians that no photo shows are drawn no more; those that photos show are not touched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.evidence.canonical import LEAST, shares_shown, without_unseen
from part2gs_robotics.evidence.cross_render import both_cost
from part2gs_robotics.model import se3
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.small_views import small_views
from part2gs_robotics.render.dispatch import render

SIDE = 80
MOVE = se3.make(np.eye(3), np.array([0.35, 0, 0]))


@pytest.fixture(scope="module")
def slid(toy):
    """A block slid over a base: Gaussians, labels and photos of both states."""
    base, block = toy.Box((0, 0, 0), (0.8, 0.6, 0.3), 1), toy.Box((0, 0, 0.3), (0.4, 0.6, 0.6), 2)
    after = toy.Box(block.lo, block.hi, 2, MOVE)
    Ks, views = toy.cameras(10, SIDE, np.array([0.4, 0.3, 0.3]), 1.3)
    pairs = [toy.gaussians_of([base, b], 0.025) for b in (block, after)]
    photos = [small_views(toy.cast([base, b], Ks, views, SIDE), 10, SIDE) for b in (block, after)]
    return [p[0] for p in pairs], [p[1] for p in pairs], photos


def joined(*gaussians):
    names = ("means", "quats", "log_scales", "logit_opacities", "sh0", "shN")
    return Gaussians(*(np.concatenate([getattr(g, n) for g in gaussians]) for n in names))


def buried(gaussians, colour):
    """Return copies that lie well inside the base and the block, opaque and of a wrong colour."""
    inside = np.linspace((0.06, 0.06, 0.06), (0.34, 0.54, 0.5), 40).astype(np.float32)
    copies = gaussians.select(np.arange(len(inside)))
    return replace(copies, means=inside, sh0=np.full_like(copies.sh0, colour),
                   logit_opacities=np.full(len(inside), 4.0, np.float32))


def test_what_lies_inside_is_not_shown_and_what_lies_outside_is(slid):
    (one, _), _, (photos, _) = slid
    shares = shares_shown(joined(one, buried(one, 2.0)), photos)
    assert (shares[len(one):] < 0.5 * LEAST).all()
    seen = one.means[:, 2] > 0.59  # the top of the block, which every camera from above sees
    assert seen.sum() > 100
    assert (shares[:len(one)][seen] > 2 * LEAST).all()
    assert shares.max() < 1.1  # no more than all of it


def test_photos_of_their_own_state_stay_the_same(slid):
    (one, _), _, (photos, _) = slid
    both = joined(one, buried(one, 2.0))
    clear = without_unseen(both, photos)
    assert len(clear) == len(both)

    def drawn(g, v):
        return render(g.splats, photos.camera(v)).color

    for v in range(3):
        assert np.abs(drawn(both, v) - drawn(clear, v)).mean() < 2e-3


def test_what_was_never_seen_does_not_speak_of_motion(slid):
    (one, two), labels, photos = slid
    wrong = buried(one, 2.0)
    both = joined(one, wrong)
    hidden = np.concatenate([labels[0], np.zeros(len(wrong), np.int64)])  # the block leaves them

    def cost(g, label):
        pair, views = (without_unseen(g, photos[0]), two), (photos[0], photos[1])
        return both_cost(pair, (label, labels[1]), [np.eye(4), MOVE], views, (1.0, 0.0))

    assert cost(both, hidden) == pytest.approx(cost(one, labels[0]), abs=1e-4)
    alone = both_cost((both, two), (hidden, labels[1]), [np.eye(4), MOVE], tuple(photos), (1, 0))
    base = both_cost((one, two), labels, [np.eye(4), MOVE], tuple(photos), (1, 0))
    assert abs(alone - base) > 1e-3  # here it would


def test_a_study_draws_no_gaussian_that_no_photo_shows(toy):
    eyes = toy.cameras(20, 64, np.array([0.3, -0.1, 0.3]), 1.3)
    base, block = toy.Box((0, 0, 0), (0.8, 0.6, 0.3), 1), toy.Box((0, 0, 0.3), (0.4, 0.6, 0.6), 2)
    plain = [toy.gaussians_of([base, b], 0.04)[0]
             for b in (block, toy.Box(block.lo, block.hi, 2, MOVE))]
    both = joined(plain[0], buried(plain[0], 2.0)), plain[1]
    study = toy.study_of(toy.scene_of(tuple(toy.drawn(g, *eyes, 64) for g in both)), both)
    assert [len(g) for g in study.gaussians] == [len(g) for g in both]
    assert study.gaussians[0].opacities[len(plain[0]):].max() < 1e-6
