"""Segments: straight edges of a photo are found to a few hundredths of a pixel."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from part2gs_robotics.evidence.segments import LEAST, segments_of

SIDE, FINE = 128, 8  # pixels, samples per pixel and direction


def half_plane(angle, offset, blocked=0.0):
    """Return a photo that is bright where n . (x - centre) > offset, and n: exact to 1 / 64."""
    rows, cols = (np.mgrid[: SIDE * FINE, : SIDE * FINE] + 0.5) / FINE
    normal = np.array([np.cos(angle), np.sin(angle)])
    height = normal[0] * (cols - SIDE / 2) + normal[1] * (rows - SIDE / 2)
    bright = np.where(height > offset, 1.0, blocked)
    return bright.reshape(SIDE, FINE, SIDE, FINE).mean((1, 3)), normal


def state_of(bright, alpha=None):
    image = np.repeat(np.round(40 + 160 * bright).astype(np.uint8)[..., None], 3, -1)
    alpha = np.full((SIDE, SIDE), 255, np.uint8) if alpha is None else alpha
    return SimpleNamespace(images=np.stack([image, image]), alphas=np.stack([alpha, alpha]),
                           Ks=np.repeat(np.eye(3)[None], 2, 0),
                           viewmats=np.repeat(np.eye(4)[None], 2, 0),
                           held_out=np.array([False, True]))


@pytest.mark.parametrize("angle", [0.0, 0.01, 0.4, 0.8, 1.5707, 2.5])
@pytest.mark.parametrize("offset", [0.0, 0.3, -7.6])
def test_an_edge_is_where_it_is(angle, offset):
    bright, normal = half_plane(angle, offset)
    found = segments_of(state_of(bright))
    assert len(found) > 0
    lengths = np.linalg.norm(found.ends[:, 1] - found.ends[:, 0], axis=1)
    assert lengths.max() > 0.6 * SIDE
    for ends in found.ends[lengths > 0.5 * SIDE]:
        heights = (ends - SIDE / 2) @ normal
        np.testing.assert_allclose(heights, offset, atol=0.12)  # a grid draws edges a tenth
        assert abs(heights[1] - heights[0]) < 0.05  # both ends alike: the direction is right


def test_a_silhouette_is_an_edge_of_its_own():
    """An object of one colour shows only its mask."""
    inside, normal = half_plane(0.4, 5.0)
    mask = np.round(255 * inside).astype(np.uint8)
    found = segments_of(state_of(np.full((SIDE, SIDE), 0.2), mask))
    longest = found.ends[np.argmax(np.linalg.norm(found.ends[:, 1] - found.ends[:, 0], axis=1))]
    np.testing.assert_allclose((longest - SIDE / 2) @ normal, 5.0, atol=0.05)


def test_held_out_photos_are_not_looked_at():
    found = segments_of(state_of(half_plane(0.4, 0.0)[0]))
    assert (found.views == 0).all()


def test_photos_without_edges_have_none():
    rng = np.random.default_rng(0)
    flat, noisy = np.full((SIDE, SIDE), 0.5), rng.random((SIDE, SIDE))
    assert len(segments_of(state_of(flat))) == 0
    few = segments_of(state_of(noisy))
    assert len(few) <= 2  # chance makes hardly any of LEAST pixels
    assert few.ends.shape[1:] == (2, 2)
    assert LEAST > 10
