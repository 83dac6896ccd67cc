"""The tutorial's pictures are what the committed script draws, and small."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
MOST = 400_000  # bytes of all of them
NEAR = 6.0  # grey levels: JPEG, and another machine's OpenGL; another picture differs by tens


@pytest.fixture(scope="module")
def drawn(load, tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    script, folder = load("tutorial_pictures"), tmp_path_factory.mktemp("textures")
    script.write_textures(folder)
    return script.walk(folder)


def committed(name: str) -> np.ndarray:
    return cv2.imread(str(ROOT / "docs" / f"tutorial_{name}.jpg"))[..., ::-1].astype(float)


def test_pictures_are_small_and_shown() -> None:
    page, pictures = (ROOT / "docs/tutorial.md").read_text(), [*(ROOT / "docs").glob("*.jpg")]
    assert sum(picture.stat().st_size for picture in pictures) < MOST
    assert all(f"({picture.name})" in page for picture in pictures)


def test_a_picture_is_what_the_script_draws(drawn: np.ndarray) -> None:
    assert np.abs(committed("walk") - drawn).mean() < NEAR
    assert np.abs(committed("walk")[:, ::-1] - drawn).mean() > 2 * NEAR, "another one is not"
