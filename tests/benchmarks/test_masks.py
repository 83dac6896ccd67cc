"""The benchmark of wrong masks changes what it says it changes, and blames nobody else."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.config import ReadConfig
from part2gs_robotics.readers.read_scene import read_scene
from part2gs_robotics.readers.silhouettes import silhouettes


@pytest.fixture(scope="module")
def masks(load):
    return load("masks")


@pytest.fixture(scope="module")
def state(ball_scene):
    return read_scene(ball_scene, ReadConfig()).states[0]


def test_close_photos_are_of_the_same_object(masks, state):
    near = masks.close(state, np.random.default_rng(0))
    changed = np.flatnonzero((near.Ks != state.Ks).any((1, 2)))
    assert len(changed) == len(state) // 3
    points = np.random.default_rng(1).uniform(-0.2, 0.2, (200, 3))
    for view in changed:
        seen = []
        for one in (state, near):
            camera = one.Ks[view] @ one.viewmats[view, :3]
            pixel = points @ camera[:, :3].T + camera[:, 3]
            column, row = np.floor(pixel[:, :2] / pixel[:, 2:]).astype(int).T
            inside = (row >= 0) & (column >= 0) & (row < one.height) & (column < one.width)
            value = np.full(len(points), np.nan)
            value[inside] = one.alphas[view][row[inside], column[inside]]
            seen.append(value)
        both = np.isfinite(seen).all(0)
        assert both.any()
        # a pixel at the outline may fall on either side
        assert (np.abs(seen[0] - seen[1])[both] > 128).mean() < 0.05


def test_noise_turns_cameras_about_their_eyes(masks, state):
    turned = masks.noisy(state, np.random.default_rng(0))
    eyes = [silhouettes(one).eyes for one in (state, turned)]
    np.testing.assert_allclose(eyes[0], eyes[1], atol=1e-9)
    cosine = (silhouettes(state).rays * silhouettes(turned).rays).sum(1)
    angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    assert angle.max() < masks.NOISE_DEG * 1.01
    assert angle.max() > 0.3 * masks.NOISE_DEG


def test_rows_and_table(masks, ball_scene, monkeypatch):
    monkeypatch.setattr(masks, "PLANTED", (5, 11))
    rows = masks.looked_at(ball_scene)
    assert {row["case"] for row in rows} == {*masks.RIGHT, *masks.WRONG}
    for row in rows:
        assert row["blamed"] == 0
        assert row["found"] == row["planted"]
    lines = masks.table({"ball": rows}).splitlines()
    assert len(lines) == 2 + len(masks.RIGHT) + len(masks.WRONG)
    assert "| three halved | 2 |" in lines[-2]
