"""Trust: photos tell depth where they have texture, and depth images always do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.evidence.depth_maps import DepthMaps
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.volume.part_maps import PartMaps
from part2gs_robotics.volume.textured import WINDOW, textured
from part2gs_robotics.volume.trust import trust

SIZE = 64
EYE = np.eye(4)


def state(image: np.ndarray) -> StateViews:
    K = np.array([[SIZE, 0, SIZE / 2], [0, SIZE, SIZE / 2], [0, 0, 1.0]])
    solid = np.full((1, SIZE, SIZE), 255, np.uint8)
    return StateViews(image[None], solid, K[None], EYE[None], None, ("a",), np.zeros(1, bool))


def half_checked() -> np.ndarray:
    """White, its right half with a pattern of dark pixels."""
    image = np.full((SIZE, SIZE, 3), 200, np.uint8)
    image[::2, SIZE // 2 :: 2] = 60
    return image


def test_texture_counts_and_noise_of_a_sensor_does_not() -> None:
    image = half_checked().astype(int)
    image += np.random.default_rng(0).normal(0, 1.5, image.shape).astype(int)
    found = textured(state(np.clip(image, 0, 255).astype(np.uint8)))[0]
    border = WINDOW // 2 + 1
    assert found[:, SIZE // 2 + border :].all()
    assert not found[:, : SIZE // 2 - border].any()


def test_with_depth_images_every_pixel_counts() -> None:
    flat = state(np.full((SIZE, SIZE, 3), 200, np.uint8))
    assert not textured(flat).any()
    assert textured(replace(flat, depths=np.ones((1, SIZE, SIZE), np.float32))).all()


@pytest.mark.parametrize("part", [0, 1])
def test_trust_is_of_views_that_see_the_point_on_the_part(part: int) -> None:
    one = state(half_checked())
    depth = np.full((1, SIZE, SIZE), 2.0, np.float32)
    maps = PartMaps(DepthMaps(depth, one.alphas, one.Ks, one.viewmats),
                    np.zeros((1, SIZE, SIZE), np.uint8), textured(one))
    points = np.array([[-0.5, 0, 2.0], [0.5, 0, 2.0], [0.5, 0, 3.0]])  # plain, textured, hidden
    found = trust(points, part, ((maps, EYE), (maps, EYE)), 0.01)
    np.testing.assert_array_equal(found, [0, 1, 0] if part == 0 else [0, 0, 0])
