"""Plain faces: the floor of a tray without texture, which stereo draws as a slope."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from plain_tray import CENTRE, CLEAN, DIAGONAL, NOISY, SIZE, WALL, seen, tray

from part2gs_robotics.config import FitConfig, StereoConfig
from part2gs_robotics.fit.hull import carve
from part2gs_robotics.fit.start import first_gaussians
from part2gs_robotics.plain import plain_faces
from part2gs_robotics.plain.plain_faces import face_normals, with_plain_faces

OFF = 0.02  # of the diagonal


def wrong(maps, noise: float) -> tuple[float, float]:
    """Return shares of the floor, and of all else, that maps put too near or too far."""
    truth, floors, rest = tray(noise), [], []
    for depths, viewmat, K in zip(maps.depths, maps.viewmats, maps.Ks, strict=True):
        v = int(np.abs(truth.viewmats - viewmat).sum((1, 2)).argmin())
        true = cv2.resize(truth.depths[v], depths.shape[::-1],
                          interpolation=cv2.INTER_NEAREST_EXACT)
        rows, columns = np.nonzero((true > 0) & (depths > 0))
        z = true[rows, columns]
        ray = np.stack([(columns + 0.5 - K[0, 2]) / K[0, 0], (rows + 0.5 - K[1, 2]) / K[1, 1],
                        np.ones(len(z))], 1)
        world_from_camera = np.linalg.inv(viewmat)
        place = (ray * z[:, None]) @ world_from_camera[:3, :3].T + world_from_camera[:3, 3]
        error = np.abs(depths[rows, columns] - z) / DIAGONAL > OFF
        floor = ((np.abs(place[:, :2] - CENTRE[:2]) < SIZE / 2 - 1.5 * WALL).all(1)
                 & (np.abs(place[:, 2] - WALL) < 0.01))
        floors.append(error[floor])
        rest.append(error[~floor])
    return float(np.concatenate(floors).mean()), float(np.concatenate(rest).mean())


@pytest.mark.parametrize("noise", [CLEAN, NOISY])
def test_a_floor_without_texture_is_found_and_nothing_else_gets_worse(noise: float) -> None:
    state, bounds, maps, views = seen(noise)
    before, outside = wrong(maps, noise)
    after, still = wrong(with_plain_faces(state, bounds, maps, views), noise)
    assert before > 0.2  # stereo alone does not tell
    assert after < 0.3 * before
    assert still < outside + 0.01


@pytest.mark.parametrize(("asked", "least", "most"), [(True, 200, 4000), (False, 0, 50)])
def test_a_fit_starts_on_the_floor_only_if_asked(asked: bool, least: int, most: int) -> None:
    state = seen(CLEAN)[0]
    start = first_gaussians(carve(state, resolution=96), state, FitConfig(start_gaussians=4000),
                            StereoConfig(plain_faces=asked))
    x, y, height = (start.means - CENTRE + [0, 0, CENTRE[2]]).T
    over = (np.abs(x) < SIZE / 2 - 2 * WALL) & (np.abs(y) < SIZE / 2 - 2 * WALL)
    assert least <= (over & (np.abs(height - WALL) < OFF * DIAGONAL)).sum() <= most


def test_the_same_maps_come_twice() -> None:
    state, bounds, maps, views = seen(CLEAN)
    one, two = (with_plain_faces(state, bounds, maps, views).depths for _ in range(2))
    np.testing.assert_array_equal(one, two)


def test_faces_look_along_the_edges_of_a_box() -> None:
    normals = np.abs(face_normals(seen(CLEAN)[0]))
    assert len(normals) == 3
    np.testing.assert_allclose(np.sort(normals, 1), np.tile([0, 0, 1.0], (3, 1)), atol=0.01)


def test_without_straight_edges_maps_stay_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    state, bounds, maps, views = seen(CLEAN)
    monkeypatch.setattr(plain_faces, "edge_families", lambda *given: [])
    assert with_plain_faces(state, bounds, maps, views) is maps


def test_depth_outside_the_object_stays_unknown() -> None:
    state, bounds, maps, views = seen(CLEAN)
    after = with_plain_faces(state, bounds, maps, views)
    assert (after.depths[maps.alphas < 0.05] == 0).all()
    assert np.isfinite(after.depths).all()
    assert (after.depths >= 0).all()
