"""Planes: what photos of a plain tray say of its floor, and which planes they agree on."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from plain_tray import CLEAN, HEIGHT, SIZE, WALL, seen

from part2gs_robotics.plain.agreed import VOICES, Spoken, agreed
from part2gs_robotics.plain.plain_faces import _views
from part2gs_robotics.plain.planes import FEWEST, Asked, likeliest, met, spoken_for
from part2gs_robotics.plain.regions import regions_of

UP = np.array([[0.0, 0.0, 1.0]])
FLOOR_TONE, NEAR = 0.8, 0.01


@pytest.fixture(scope="module")
def floor():
    """What other photos say of the largest view of the tray's floor."""
    _, bounds, maps, views = seen(CLEAN)
    photos = _views(bounds, maps, views)
    asked = [Asked(photos, v, one) for v in range(8)
             for one in regions_of(photos.images[v], np.random.default_rng(v))
             if abs(np.median(one.colors) - FLOOR_TONE) < NEAR]
    return max(asked, key=lambda one: len(one.region.pixels))


def test_the_floor_is_where_its_rim_is_seen(floor: Asked) -> None:
    score, (_, offset) = max(spoken_for(floor, UP))
    assert offset == pytest.approx(WALL, abs=NEAR)
    assert score > 0.2
    assert score > floor.own() + 0.2  # of stereo's slope


def test_photos_look_past_a_lid_and_not_past_the_floor(floor: Asked) -> None:
    past = floor.past(UP[0], np.array([WALL, HEIGHT]))
    assert past[0] < 0.03
    assert past[1] > 0.2


def test_of_given_planes_the_floor_is_likeliest(floor: Asked) -> None:
    planes = [(0, offset) for offset in (0.0, WALL, 0.5 * HEIGHT, HEIGHT)]
    assert likeliest(floor, UP, planes)[1] == (0, WALL)
    assert likeliest(floor, UP, []) is None


def test_only_photos_of_its_own_side_face_a_plane(floor: Asked) -> None:
    facing = floor.facing(UP[0], np.array([WALL, 10 * SIZE]))
    eyes = floor.views.eyes[floor.views.near[floor.view]]
    assert facing[0].sum() >= FEWEST
    assert (eyes[facing[0], 2] > WALL).all()
    assert not facing[1, eyes[:, 2] > 10 * SIZE].any()  # this one is below such a plane


def test_depths_where_rays_meet_planes() -> None:
    rays = np.array([[0.0, 0.0, -1.0], [0.6, 0.0, -0.8], [1.0, 0.0, 0.0]])
    depths = met(np.array([0.0, 0.0, 2.0]), rays, UP[0], np.array([0.0, 1.0]))
    np.testing.assert_allclose(depths, [[2.0, 2.5, 0.0], [1.0, 1.25, 0.0]])


def spoken(view: int, *planes) -> Spoken:
    return Spoken(SimpleNamespace(view=view), list(planes))


def test_one_photo_alone_makes_no_plane_however_sure() -> None:
    alone = [spoken(0, (0.9, (0, 1.0))), spoken(0, (0.8, (0, 1.001))), spoken(1, (0.9, (0, 2.0)))]
    assert agreed(alone, 0.01) == []


def test_planes_of_one_layer_are_one_and_stand_at_their_mean() -> None:
    found = [spoken(v, (0.3, (0, 1.0 + 0.001 * v)), (0.3, (1, 5.0))) for v in range(4)]
    planes = agreed(found, 0.01)
    assert [k for k, _ in planes] == [0, 1]
    assert planes[0][1] == pytest.approx(1.0015)


def test_voices_below_chance_are_not_heard() -> None:
    low = 0.9 * VOICES / 4
    assert agreed([spoken(v, (low, (0, 1.0))) for v in range(4)], 0.01) == []
    assert len(agreed([spoken(v, (2 * low, (0, 1.0))) for v in range(4)], 0.01)) == 1
