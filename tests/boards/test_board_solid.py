"""Boards: exact solids out of what photos say, closed forms and planted defects."""

from dataclasses import replace

import numpy as np
import pytest
from board_room import GRID, VOXEL, box_distance, points, solid_of, surface_of, volume

from part2gs_robotics.boards.board_solid import BoardSolid, filled, refined
from part2gs_robotics.boards.cells import cells_of
from part2gs_robotics.boards.outlines import Outlines
from part2gs_robotics.boards.planes import Family
from part2gs_robotics.boards.polyhedra import convex_cells, joined
from part2gs_robotics.boards.rest import boxes_of, contradicted, with_rest
from part2gs_robotics.model.arrays import F32, F64, Mask


def test_a_noisy_box_is_one_convex_piece_with_twelve_triangles() -> None:
    half = np.array([0.31, 0.23, 0.41])
    noise = np.random.default_rng(0).normal(0, 0.2 * VOXEL, GRID.shape)
    solid = solid_of(box_distance(half) + noise)
    assert len(solid.pieces) == 1
    assert solid.whole.num_tri() == 12
    assert np.allclose(solid.whole.bounding_box(), [*-half, *half], atol=0.5 * VOXEL)
    assert not solid.curved


def test_an_open_box_keeps_its_room() -> None:
    half = np.array([0.4, 0.4, 0.4])
    room = box_distance(half - np.array([0.08, 0.08, 0.04]), np.array([0, 0, 0.12]))
    solid = solid_of(np.minimum(box_distance(half), -room))
    hollow = 0.8**3 - 0.64**2 * 0.64
    assert abs(volume(solid) - hollow) < 0.05 * hollow
    assert solid.whole.genus() == 0
    total = sum(piece.volume() for piece in solid.pieces)
    assert abs(total - volume(solid)) < 0.02 * volume(solid)  # pieces hardly overlap


def test_a_ball_is_curved() -> None:
    ball = 0.4 - np.linalg.norm(points(), axis=-1)
    assert solid_of(ball).curved


def test_no_cell_is_invented_and_none_is_lost_without_doubt() -> None:
    families = tuple(Family(axis, np.array([-0.205, 0.195])) for axis in np.eye(3))
    cells = cells_of(GRID, families)
    assert len(cells) == 27
    middle = (cells.digits == 1).all(1)
    whole = joined(convex_cells(cells, middle), VOXEL)
    assert whole.volume() == pytest.approx(0.4**3, rel=1e-2)


def test_what_rays_ask_for_fills_a_hole_that_belief_leaves() -> None:
    half = np.array([0.4, 0.4, 0.05])
    distance = box_distance(half)
    solid = solid_of(distance)
    doubtful = replace(solid.belief, inside=np.where(
        distance > 0, np.float32(-0.02), solid.belief.inside).astype(np.float32))
    torn = filled(replace(solid, belief=doubtful), np.zeros(GRID.shape))
    assert volume(torn) < 0.1 * volume(solid)
    full = (distance > 0).astype(float)
    assert volume(filled(torn, 1e4 * full)) == pytest.approx(volume(solid), rel=1e-6)


def masks_of(half: F64, count: int = 8, size: int = 160) -> Outlines:
    """Return exact masks of a box, by the hull of its corners."""
    import cv2

    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    alphas, projections = [], []
    for k in range(count):
        angle, tilt = 2 * np.pi * k / count + 0.3, 0.5 * (-1) ** k
        back = np.array([np.cos(angle) * np.cos(tilt), np.sin(angle) * np.cos(tilt), np.sin(tilt)])
        right = np.cross(back, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        turn = np.stack([right, np.cross(-back, right), -back])
        K = np.array([[1.5 * size, 0, size / 2], [0, 1.5 * size, size / 2], [0, 0, 1]])
        project = K @ np.column_stack([turn, turn @ (-2.5 * back)])
        seen = corners @ project[:, :3].T + project[:, 3]
        pixels = seen[:, :2] / seen[:, 2:]
        outline = cv2.convexHull(((pixels - 0.5) * 4 * 16 + 24).astype(np.int32))
        fine = np.zeros((4 * size, 4 * size), np.uint8)
        cv2.fillConvexPoly(fine, outline, 255, shift=4)
        alphas.append(cv2.resize(fine, (size, size), interpolation=cv2.INTER_AREA))
        projections.append(project)
    return Outlines(np.stack(alphas), np.stack(projections))


def test_planes_move_onto_the_outlines_of_masks() -> None:
    half = np.array([0.31, 0.23, 0.41])
    off = half + np.array([0.6, -0.5, 0.4]) * VOXEL  # fitted wrong by half a cell
    solid = solid_of(box_distance(off))
    drawn = refined(solid, [masks_of(half), masks_of(half, 10)])
    before = np.abs(np.array(solid.whole.bounding_box())[3:] - half).max()
    after = np.abs(np.array(drawn.whole.bounding_box())[3:] - half).max()
    assert after < 0.5 * before
    assert after < 0.2 * VOXEL


def knob() -> tuple[BoardSolid, F32, Mask]:
    """Return a slab, values of a slab with a knob on it, and where the knob is."""
    slab = box_distance(np.array([0.4, 0.4, 0.06]))
    ball = 0.1 - np.linalg.norm(points() - [0.1, 0.1, 0.16], axis=-1)
    both = np.maximum(slab, ball)
    return solid_of(slab), (both / VOXEL).astype(np.float32), np.asarray((ball > 0) & (slab < 0))


def test_a_knob_that_rays_miss_comes_back_smooth() -> None:
    import manifold3d

    solid, fine, where = knob()
    vertices, faces = surface_of(fine.astype(float) * VOXEL)
    smooth = manifold3d.Manifold(manifold3d.Mesh64(vertices, faces.astype(np.uint64)))
    wanted = where.astype(float)
    with_knob = with_rest(solid, smooth, fine, wanted)
    assert volume(with_knob) == pytest.approx(smooth.volume(), rel=0.03)
    assert with_knob.whole.status() == manifold3d.Error.NoError
    assert with_rest(solid, smooth, fine, np.zeros(GRID.shape)) is solid  # nobody misses it


def test_bulges_of_rooms_within_are_no_contradiction() -> None:
    solid, fine, _ = knob()
    slab = solid.values > 0
    quiet = replace(solid.belief, outside=np.zeros(GRID.shape, bool))
    assert not contradicted(quiet, slab, fine > 0, np.zeros(GRID.shape)).any()
    background = replace(quiet, outside=slab & (points()[..., 0] > 0.2))
    assert contradicted(background, slab, fine > 0, np.zeros(GRID.shape)).any()


def test_boxes_cover_a_mask_and_do_not_overlap() -> None:
    rng = np.random.default_rng(0)
    where = rng.random((13, 17, 9)) > 0.97
    count = np.zeros((20, 24, 16), int)
    for box in boxes_of(where):
        count[tuple(slice(a, b) for a, b in zip(box.low, box.high, strict=True))] += 1
    assert count.max() == 1
    assert (count[:13, :17, :9][where] == 1).all()
