"""Marks on photos: nothing where the moved Gaussians look as photographed, planted patches else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.report.data import Picture
from part2gs_robotics.report.unexplained import DIFFERS, HIDDEN, unexplained


def seen(rng: np.random.Generator) -> Picture:
    """Return an object of 40 x 40 pixels amid white, shown exactly as photographed."""
    photo = np.full((60, 60, 3), 255, np.uint8)
    photo[10:50, 10:50] = rng.integers(60, 180, (40, 40, 3))
    mask = np.zeros((60, 60), bool)
    mask[10:50, 10:50] = True
    moved = np.concatenate([photo, 255 * mask[..., None].astype(np.uint8)], -1)
    return Picture("state 1", 1, photo, photo, moved, mask)


@pytest.fixture
def picture() -> Picture:
    return seen(np.random.default_rng(0))


@pytest.mark.parametrize("gain", [1.0, 0.7, 1.3])
def test_what_looks_as_photographed_is_not_marked_however_bright_the_state_was(
        picture: Picture, gain: float) -> None:
    moved = picture.moved.copy()
    moved[10:50, 10:50, :3] = np.clip(moved[10:50, 10:50, :3] * gain, 0, 255)
    found = unexplained(replace(picture, moved=moved))
    assert (found.differs, found.hidden) == (0.0, 0.0)


def test_a_patch_that_looks_different_is_marked_where_it_is(picture: Picture) -> None:
    moved = picture.moved.copy()
    moved[20:30, 20:28, :3] = 255
    found = unexplained(replace(picture, moved=moved))
    assert found.differs == pytest.approx(80 / 1600, abs=2 / 1600)
    assert (found.image[21:29, 21:27] == DIFFERS).all()
    assert not (found.image[31:49, 11:49] == DIFFERS).all(-1).any()


def test_what_the_other_state_did_not_see_is_another_mark(picture: Picture) -> None:
    moved = picture.moved.copy()
    moved[40:50, 10:50] = 255
    moved[40:50, 10:50, 3] = 0
    found = unexplained(replace(picture, moved=moved))
    assert (found.differs, found.hidden) == (0.0, pytest.approx(400 / 1600))
    assert (found.image[41:49, 11:49] == HIDDEN).all()


def test_what_is_shown_where_the_photo_has_nothing_differs(picture: Picture) -> None:
    moved = picture.moved.copy()
    moved[52:58, 10:50] = (90, 90, 90, 255)
    assert unexplained(replace(picture, moved=moved)).differs == pytest.approx(240 / 1600)


def test_an_outline_one_pixel_wide_is_blur(picture: Picture) -> None:
    moved = picture.moved.copy()
    moved[10, 10:50, 3] = 0
    moved[50, 10:50] = (90, 90, 90, 255)
    found = unexplained(replace(picture, moved=moved))
    assert (found.differs, found.hidden) == (0.0, 0.0)


def test_without_the_other_state_nothing_is_claimed(picture: Picture) -> None:
    assert unexplained(replace(picture, moved=None)) is None
