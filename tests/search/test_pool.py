"""The pool is searched in the light that what turned tells of, not in that of paint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from toys import Box, cameras, drawn, gaussians_of, scene_of, study_of

from part2gs_robotics.config import SearchConfig
from part2gs_robotics.evidence.light import Light
from part2gs_robotics.model.se3 import screw_motion
from part2gs_robotics.search.pool import in_its_light

FEW = SearchConfig(patches=9)
SHADES = np.array([0.0, 0.5, 0, 0, 0, 0, 0, 0])  # faces to the side are brighter


@pytest.fixture(scope="module")
def study():
    """A block on a base, turned a quarter about the vertical, as bright as before."""
    base, block = Box((0, 0, 0), (0.9, 0.8, 0.2), 1), Box((0.1, 0.1, 0.2), (0.5, 0.4, 0.5), 2)
    turn = screw_motion(np.array([0.0, 0, 1]), np.array([0.45, 0.4, 0]), np.pi / 2, 0.0)
    pairs = [gaussians_of(boxes, 0.04)[0]
             for boxes in ([base, block], [base, Box(block.lo, block.hi, 2, turn)])]
    eyes = cameras(16, 56, np.array([0.45, 0.4, 0.25]), 1.1)
    return study_of(scene_of(tuple(drawn(one, *eyes, 56) for one in pairs)), pairs)


def chosen(study):
    moved = sum(map(len, study.evidence.sets))
    return in_its_light(study, np.random.default_rng(0), moved, FEW)


def test_paint_that_looked_like_light_is_paint_again(study):
    even = study.under(np.zeros(8))
    found = chosen(even.under(SHADES))
    assert found.light.even
    for s in (0, 1):
        np.testing.assert_allclose(found.surfels[s].colors, even.surfels[s].colors)
        np.testing.assert_allclose(found.lands[s].rows, even.lands[s].rows)
        assert not found.lands[s].shades.any()


def test_light_that_turned_faces_show_stays(study):
    """The same block where faces to the side are brighter, and colours lack that already."""
    even = study.under(np.zeros(8))
    zero, one = (replace(land, shades=SHADES) for land in even.lands)
    lit = replace(even, lands=(zero, one), light=Light(SHADES, even.light.normals))
    assert chosen(lit) is lit


def test_even_light_asks_for_no_search(study):
    even = study.under(np.zeros(8))
    assert in_its_light(even, None, 0, FEW) is even


def test_colours_in_another_light_come_back(study):
    there = study.under(SHADES)
    back = there.under(study.light.shades)
    assert not np.allclose(there.surfels[0].colors, study.surfels[0].colors)
    for own, old in zip((*back.surfels, *back.evidence.sets),
                        (*study.surfels, *study.evidence.sets), strict=True):
        np.testing.assert_allclose(own.colors, old.colors)
