"""Masks of what stands on the plane: shape and outlines in turn, until all views agree."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.photos.posed import Posed, focus
from part2gs_robotics.photos.rough_shape import main_piece, rough_shapes
from part2gs_robotics.photos.table_picture import OBJECT, TABLE, seen_on_plane, table_picture
from part2gs_robotics.photos.views import Bools, Grid, Views, small_views
from part2gs_robotics.runtime.threads import in_threads

log = logging.getLogger(__name__)

U8 = NDArray[np.uint8]

SMALL = 400  # px of the longer side while shape and outlines are looked for
HALF, HEIGHT = 0.55, 0.9  # of the cameras' distance: the space that all see, to the sides and up
ROUGH_CELLS, CELLS = 72, 112  # along the longest side: a cell is 4 px, then 2 px of a small photo
# Per round: outline within these px inside and outside of the hull, votes forgiven, foot in cells.
ROUND_BANDS = ((10, 30, 0.15, 5), (8, 16, 0.10, 3), (6, 6, 0.08, 1))
UNSURE_VOTE = 0.6  # of a view whose background is not the plane, beside one whose background is
ITERATIONS = 3  # of colours and cut in turn: not swept; rounds follow that mend it
CONTEXT = 0.12  # of the longer side: background about the object that its colours are learnt from
POOR = 0.85  # overlap of a mask with the shape of all: right ones reach 0.90, so all know better
SLACK = 2  # small pixels a mask may stick out of the shape of all: a cell and a pose's error
LAST_BAND = 3  # small pixels about the last outline: what the full photo decides


@dataclass(frozen=True)
class Masks:
    """Masks of both states.

    Attributes:
        masks: per state, one [H, W] uint8 per photo, 255 = object.
        agree: per state [V], overlap (IoU) of each mask with the shape of all.
        box: [2, 3] corners of both states' shapes.
    """

    masks: tuple[list[U8], list[U8]]
    agree: tuple[F64, F64]
    box: F64


def make_masks(photos: tuple[Sequence[U8], Sequence[U8]], posed: Posed) -> Masks:
    """Return masks of the object that stands on the plane z = 0.

    Args:
        photos: undistorted, [H, W, 3] uint8, per state, of the registered names.
        posed: in the frame of `support.find_support`.

    Raises:
        SceneError: no object is found.
    """
    middle, radius = focus(posed.all_viewmats)
    views = [small_views(photos[s], posed.K, posed.viewmats[s], SMALL) for s in (0, 1)]
    grids, filled = _rough(views, middle, radius)
    box = [(g.points[f].min(0), g.points[f].max(0)) for g, f in zip(grids, filled, strict=True)]
    masks, agree, corners = [], [], []
    for s in (0, 1):
        state = _State.of(views[s], box[s], filled[s], grids[s], 0.8 * radius)
        for number in range(len(ROUND_BANDS)):
            state = state.refined(number)
        hulls = state.grid.outlines(state.filled)
        agree.append(np.array([_overlap(a, b) for a, b in zip(state.masks, hulls, strict=True)]))
        masks.append(_last(photos[s], state, hulls))
        cells = state.grid.points[state.filled]
        corners += [cells.min(0), cells.max(0)]
        log.info("state %d: masks agree with the shape of all to %.3f (median IoU)", s,
                 float(np.median(agree[s])))
    return Masks((masks[0], masks[1]), (agree[0], agree[1]),
                 np.stack([np.min(corners, axis=0), np.max(corners, axis=0)]))


@dataclass(frozen=True)
class _State:
    """Shape and masks of one state as they are now."""

    views: Views
    grid: Grid
    filled: Bools
    masks: U8
    tables: U8
    half: float

    @classmethod
    def of(cls, views: Views, box: tuple[F64, F64], rough: Bools, coarse: Grid, half: float,
           ) -> _State:
        """Return the rough shape in a finer grid with room for what it lacks."""
        room = 0.2 * float((box[1] - box[0]).max())
        lo, hi = box[0] - room, box[1] + room
        lo[2] = max(lo[2], 0.0)
        grid = Grid.of(lo, hi, CELLS, views)
        near = coarse.outlines(rough)
        filled = grid.votes(list(1 - near)) < 0.02  # the rough shape's own outlines, drawn finer
        return cls(views, grid, filled, near, np.zeros_like(near), half)

    def refined(self, number: int) -> _State:
        """Return shape and masks after one more round."""
        inside, outside, forgiven, foot = ROUND_BANDS[number]
        hulls = self.grid.outlines(self.filled)
        wide = np.stack([cv2.dilate(h, np.ones((9, 9), np.uint8)) for h in hulls])
        picture = table_picture(self.views, wide, self.half, self.grid.points[self.filled], foot)

        def cut(v: int) -> tuple[U8, U8, NDArray[np.float32]]:
            table = picture.evidence(v)
            mask = cut_out(self.views.rgb[v], hulls[v], table, (inside, outside), number > 0)
            near = cv2.dilate(hulls[v], np.ones((2 * outside + 1, 2 * outside + 1), np.uint8))
            may = cv2.dilate(mask | ((table == OBJECT) & (near > 0)), np.ones((3, 3), np.uint8))
            vote = np.where(may > 0, 0.0, np.where(table > 0, 1.0, UNSURE_VOTE))
            return mask, table, vote.astype(np.float32)

        done = in_threads([partial(cut, v) for v in range(len(self.views))])
        votes = self.grid.votes([one[2] for one in done])
        filled = (votes <= forgiven) & (self.grid.share_seen() > 0.5)
        if filled.any():
            filled = main_piece(filled, self.grid, np.ones(len(filled)))
        return _State(self.views, self.grid, filled, np.stack([one[0] for one in done]),
                      np.stack([one[1] for one in done]), self.half)


def _rough(views: Sequence[Views], middle: F64, radius: float) -> tuple[list[Grid], list[Bools]]:
    lo, hi = np.array([-HALF, -HALF, 0.0]) * radius, np.array([HALF, HALF, HEIGHT]) * radius
    grids = [Grid.of(lo, hi, ROUGH_CELLS, state) for state in views]
    tables = []
    for state in views:
        nothing = np.zeros((len(state), *state.size), np.uint8)
        picture = table_picture(state, nothing, 0.8 * radius, np.zeros((0, 3)))
        tables.append([picture.evidence(v) for v in range(len(state))])
    swept = [seen_on_plane(state, middle) for state in views]
    return grids, rough_shapes(views, grids, tables, swept, middle, radius)


def _last(photos: Sequence[U8], state: _State, hulls: U8) -> list[U8]:
    """Return masks at the photos' size: a last cut in a narrow band about the small ones."""
    slack = np.ones((2 * SLACK + 1,) * 2, np.uint8)

    def cut(v: int) -> U8:
        size = photos[v].shape[1], photos[v].shape[0]
        scale = size[0] / state.views.size[1]
        small = state.masks[v] & cv2.dilate(hulls[v], slack)  # what no other view sees is no object
        small = hulls[v] if _overlap(small, hulls[v]) < POOR else small
        smooth = cv2.resize(255 * small, size, interpolation=cv2.INTER_LINEAR)
        table = cv2.resize(state.tables[v], size, interpolation=cv2.INTER_NEAREST)
        band = max(1, round(LAST_BAND * scale))
        hull = np.asarray(smooth > 127, np.uint8)
        # the plane's word is as coarse as the small photos: near the outline the colours decide
        edge = cv2.morphologyEx(hull, cv2.MORPH_GRADIENT, np.ones((2 * band + 1,) * 2, np.uint8))
        table[edge > 0] = 0
        return np.asarray(255 * cut_out(photos[v], hull, table, (band, band), False), np.uint8)

    return in_threads([partial(cut, v) for v in range(len(photos))])


def _overlap(one: U8, two: U8) -> float:
    return float((one & two).sum() / max(int((one | two).sum()), 1))


def cut_out(rgb: U8, hull: U8, table: U8, band: tuple[int, int], trusted: bool) -> U8:
    """Return the mask [H, W] uint8 of 0 and 1.

    Args:
        rgb: [H, W, 3].
        hull: [H, W] uint8, 1 where the other views let the object be.
        table: [H, W] what the plane says of each pixel.
        band: pixels within which the outline lies inside and outside of the hull's.
        trusted: whether the hull is good enough for what the plane calls an object to be one.
    """
    if not hull.any():
        return np.zeros_like(hull)
    inner, near = cv2.erode(hull, _disk(band[0])) > 0, cv2.dilate(hull, _disk(band[1])) > 0
    other = (table == OBJECT) & near
    seeds = np.where((hull > 0) | other, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    if trusted:
        seeds[other & (hull > 0)] = cv2.GC_FGD
    seeds[(table == TABLE) | ~near] = cv2.GC_BGD
    seeds[inner] = cv2.GC_FGD
    y, x = _window(near, round(CONTEXT * max(hull.shape)))
    part = np.ascontiguousarray(seeds[y, x])
    out = np.zeros_like(hull)
    if ((part == cv2.GC_BGD) | (part == cv2.GC_PR_BGD)).any() and (part & 1).any():
        cv2.setRNGSeed(0)
        cv2.grabCut(np.ascontiguousarray(rgb[y, x]), part, None, np.zeros((1, 65)),
                    np.zeros((1, 65)), ITERATIONS, cv2.GC_INIT_WITH_MASK)
    out[y, x] = part & 1
    return out


def _disk(radius: int) -> U8:
    side = 2 * radius + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)


def _window(near: NDArray[np.bool_], margin: int) -> tuple[slice, slice]:
    """Return the rows and columns of what is near, with a margin."""
    rows, columns = (np.flatnonzero(near.any(axis)) for axis in (1, 0))
    return (slice(max(rows[0] - margin, 0), rows[-1] + margin + 1),
            slice(max(columns[0] - margin, 0), columns[-1] + margin + 1))
