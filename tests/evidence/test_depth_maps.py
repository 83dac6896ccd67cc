import numpy as np
import pytest

from part2gs_robotics.evidence.depth_maps import DepthMaps, observe

SIZE, FOCAL, DISTANCE = 64, 80.0, 2.0


def wall_maps(alpha_dtype=np.float32, views=3) -> DepthMaps:
    """Cameras at z = -DISTANCE looking along +z at a wall z = 0 that fills the right half."""
    depths = np.zeros((views, SIZE, SIZE), np.float32)
    depths[:, :, SIZE // 2:] = DISTANCE
    scale = 255 if alpha_dtype == np.uint8 else 1
    alphas = ((depths > 0) * scale).astype(alpha_dtype)
    K = np.array([[FOCAL, 0, SIZE / 2], [0, FOCAL, SIZE / 2], [0, 0, 1.0]])
    viewmat = np.eye(4)
    viewmat[2, 3] = DISTANCE
    return DepthMaps(depths, alphas, np.repeat(K[None], views, 0),
                     np.repeat(viewmat[None], views, 0))


POINTS = np.array([
    [0.3, 0, -0.5],  # in front of the wall
    [0.3, 0, 0.0],  # on it
    [0.3, 0, 0.5],  # behind it
    [-0.3, 0, 0.0],  # beside it, before the background
    [0.3, 0, -9.0],  # behind the cameras
    [9.0, 0, 0.0],  # outside the images
])


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_each_kind_of_point_gets_its_own_count(dtype):
    seen = observe(POINTS, wall_maps(dtype), 0.01)
    assert seen.free.tolist() == [3, 0, 0, 3, 0, 0]
    assert seen.surface.tolist() == [0, 3, 0, 0, 0, 0]
    assert seen.hidden.tolist() == [0, 0, 3, 0, 0, 0]
    assert seen.outside.tolist() == [0, 0, 0, 3, 0, 0]


def test_a_point_on_the_silhouette_is_never_free_or_hidden():
    x = np.linspace(-0.5, 0.5, 201) / FOCAL * DISTANCE  # half a pixel to either side of the edge
    seen = observe(np.stack([x, 0 * x, 0 * x + 0.05], 1), wall_maps(), 0.01)
    beside = np.abs(x) < 0.45 / FOCAL * DISTANCE
    assert not (seen.free + seen.hidden + seen.outside)[beside].any()


def test_unknown_pixels_vote_for_nothing():
    maps = wall_maps()
    opaque = DepthMaps(maps.depths, np.ones_like(maps.alphas), maps.Ks, maps.viewmats)
    seen = observe(POINTS[3:4], opaque, 0.01)
    assert seen.free[0] == seen.surface[0] == seen.hidden[0] == seen.outside[0] == 0


def test_observation_does_not_depend_on_the_world_frame():
    from part2gs_robotics.model.se3 import apply, inverse, screw_motion

    rng = np.random.default_rng(0)
    points = rng.uniform(-0.4, 0.4, (500, 3))
    maps = wall_maps()
    move = screw_motion(np.array([0.6, 0, 0.8]), np.array([1.0, 2, 3]), 0.7, 0.4)
    moved = DepthMaps(maps.depths, maps.alphas, maps.Ks, maps.viewmats @ inverse(move))
    a, b = observe(points, maps, 0.01), observe(apply(move, points), moved, 0.01)
    for name in ("free", "surface", "hidden", "outside"):
        assert (getattr(a, name) == getattr(b, name)).all()
    assert a.free.sum() > 0
    assert a.hidden.sum() > 0


def test_background_is_free_at_any_tolerance():
    seen = observe(POINTS[:4], wall_maps(), np.inf)
    assert seen.outside.tolist() == [0, 0, 0, 3]
