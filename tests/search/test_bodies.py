"""Bodies: what hangs together is searched as one, however small it is."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.search.bodies import GAP, LEAST, MOST, bodies, propose_bodies

pytestmark = pytest.mark.usefixtures("one_numba_thread")


def clusters(sizes, apart, step=0.004):
    """Return surfels in rows of some lengths, `apart` from each other."""
    rows = [np.stack([step * np.arange(n), np.full(n, apart * k), np.zeros(n)], 1)
            for k, n in enumerate(sizes)]
    points = np.concatenate(rows)[np.random.default_rng(0).permutation(sum(sizes))]
    up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    return Surfels(points, up, np.zeros_like(points), np.full(len(points), 5))


def test_every_body_comes_whole_and_the_largest_first():
    sizes = [LEAST + 3, LEAST - 1, LEAST + 20, LEAST + 7]
    found = bodies(clusters(sizes, 1.5 * GAP), 1.0)
    assert [len(b) for b in found] == sorted((n for n in sizes if n >= LEAST), reverse=True)
    for body in found:
        assert np.ptp(body.points[:, 1]) < 1e-12, "surfels of one row"


def test_what_lies_nearer_than_a_gap_is_one_body_in_any_unit():
    surfels = clusters([LEAST] * 4, 0.5 * GAP)
    for unit in (1.0, 1e-3, 1e3):
        scaled = Surfels(unit * surfels.points, *(getattr(surfels, name) for name in
                                                  ("normals", "colors", "views")))
        assert [len(b) for b in bodies(scaled, unit)] == [4 * LEAST]


def test_specks_are_no_bodies_and_no_more_are_searched_than_can_be():
    assert bodies(clusters([LEAST - 1], 1.0), 1.0) == []
    assert bodies(clusters([LEAST - 1] * 3, 1.5 * GAP), 1.0) == []
    assert len(bodies(clusters([LEAST] * (MOST + 3), 1.5 * GAP), 1.0)) == MOST


def test_true_motions_are_among_those_of_the_bodies(look_alikes):
    study = look_alikes.study
    found = propose_bodies(study, np.random.default_rng(0), 80)
    slides = [h.move[:3, 3] for h in found if not h.turns]
    for true in look_alikes.truth:
        assert min(np.linalg.norm(way - true.move[:3, 3]) for way in slides) < 0.02 * study.diag
