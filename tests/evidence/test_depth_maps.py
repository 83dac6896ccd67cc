import numpy as np
import pytest

from part2gs_robotics.evidence.depth_maps import (
    DepthMaps,
    look_past,
    observe,
    render_depth_maps,
)
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.scene import StateViews

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


def test_what_shows_behind_a_free_point_is_the_mean_of_the_photos():
    """Three views past one point: two see the wall, light and dark, one the background."""
    maps = wall_maps()
    depths, alphas = maps.depths.copy(), maps.alphas.copy()
    depths[2], alphas[2] = 0.0, 0.0
    images = np.zeros((3, SIZE, SIZE, 3), np.uint8)
    images[0], images[1], images[2] = (200, 100, 50), (100, 100, 0), (255, 255, 255)
    seen, behind = look_past(POINTS, DepthMaps(depths, alphas, maps.Ks, maps.viewmats, images),
                             0.01)
    assert seen.free.tolist() == [3, 1, 1, 3, 0, 0]
    np.testing.assert_allclose(behind[0], [150 / 255, 100 / 255, 25 / 255, 1 / 3], atol=1e-6)
    np.testing.assert_array_equal(behind[1:, 3], 1.0)  # nothing but background, or no view
    assert (look_past(POINTS, maps, 0.01)[1][:, 3] == 1.0).all(), "no image is known"


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


def flat(x, y, z, opacity) -> Gaussians:
    """Small discs over a rectangle, as opaque together as one of them is in its middle."""
    place = np.stack(np.meshgrid(np.arange(*x, 0.02), np.arange(*y, 0.02)), -1).reshape(-1, 2)
    n = len(place)
    scales = np.log(np.tile([0.012, 0.012, 0.001], (n, 1)))
    return Gaussians(np.column_stack([place, np.full(n, z)]).astype(np.float32),
                     np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
                     scales.astype(np.float32),
                     np.full(n, np.log(opacity / (1 - opacity)), np.float32),
                     np.zeros((n, 3), np.float32), np.zeros((n, 0, 3), np.float32))


def drawn(*layers: Gaussians) -> np.ndarray:
    """The depth map of layers, seen from DISTANCE before z = 0; every pixel is the object's."""
    names = ("means", "quats", "log_scales", "logit_opacities", "sh0", "shN")
    one = Gaussians(*(np.concatenate([getattr(g, name) for g in layers]) for name in names))
    maps = wall_maps(views=1)
    solid = np.full((1, SIZE, SIZE), 255, np.uint8)
    views = StateViews(np.zeros((1, SIZE, SIZE, 3), np.uint8), solid, maps.Ks, maps.viewmats, None,
                       ("a",), np.zeros(1, bool))
    return render_depth_maps(one, views, 0.05).depths[0]


WALL = flat((-0.7, 0.7), (-0.7, 0.7), 0.0, 0.95)


def test_what_is_seen_through_a_pane_has_no_first_surface():
    there = slice(SIZE // 2 - 8, SIZE // 2 + 8)
    for opacity in (0.1, 0.3):  # of every disc; about three cover a pixel
        depth = drawn(flat((-0.3, 0.3), (-0.3, 0.3), -0.5, opacity), WALL)
        assert (depth[there, there] == 0).all()
        np.testing.assert_allclose(depth[7:13, there], DISTANCE, atol=0.02)  # beside the pane
    np.testing.assert_allclose(drawn(WALL)[there, there], DISTANCE, atol=0.02)
    board = drawn(flat((-0.3, 0.3), (-0.3, 0.3), -0.5, 0.95), WALL)
    np.testing.assert_allclose(board[there, there], DISTANCE - 0.5, atol=0.02)


def test_rims_of_outlines_keep_their_depth():
    """A board before a wall: its rim is mixed of both, three pixels wide."""
    depth = drawn(flat((-0.3, 0.3), (-0.3, 0.3), -0.5, 0.95), WALL)
    inner = depth[7:-7, 7:-7]
    assert (inner > 0).all()


def test_a_rough_fit_keeps_its_surface():
    """Every ray is stopped in two places far apart: that is noise of the fit, no pane."""
    depth = drawn(flat((-0.7, 0.7), (-0.7, 0.7), -0.5, 0.3), WALL)
    assert (depth[8:-8, 8:-8] > 0).all()
