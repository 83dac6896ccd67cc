"""What lies on the support plane, from all views, and where a photo shows something else.

A plane looks alike in every view once it is drawn from above: each photo says of every cell of the
plane what it sees there, and the median is the plane where the object hides it in less than half
of them. A photo that shows something else in a cell has something in front of it. Shadows lie on
the plane: they belong to it. Where its pattern shows, neighbouring photos tell the plane by
themselves, whatever is known of the object (`seen_on_plane`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F32, F64
from part2gs_robotics.photos.posed import eyes
from part2gs_robotics.photos.views import Views
from part2gs_robotics.runtime.threads import in_threads

U8 = NDArray[np.uint8]

CELLS = 256  # along the picture: a cell is 2 px of a small photo, as much as it is blurred
MOST_VIEWS = 32  # photos the median is taken of: time grows with them, noise is gone
FEWEST_VIEWS = 4  # that show a cell: a median of three follows one wrong photo
STEADY = (12.0, 5.0, 5.0)  # L, a, b: views of a cell differ by less, save at edges and above it
NOISE = (6.0, 2.5, 2.5)  # L, a, b counts of 8 bit: noise, JPEG, shine and a cell's own blur
SAME, OTHER = 2.0, 4.0  # sigma: noise exceeds the first in 1 of 20 cells, the second never
LOW = 0.12  # of half the side: sides of an object below it are seen near where it stands
UNKNOWN, TABLE, OBJECT = 0, 1, 2  # what `evidence` says of a pixel
HEIGHTS = -0.02, 0.0, 0.02, 0.04, 0.07, 0.1  # of the cameras' distance: 2 % moves a pattern by 2 px
BESIDE_DEG = 8.0, 50.0  # between views: nearer ones see all heights alike, farther ones other sides
NEIGHBOURS, AGREEING = 6, 3  # one in two of the nearest may be hidden behind the object
WINDOW = 11  # px of a small photo: a pattern that repeats within it is none
ALIKE = 0.7  # correlation: chance reaches 0.5 among so many pixels
PATTERN = 4.0  # variance of grey levels: noise and JPEG have 1 to 3


@dataclass(frozen=True)
class TablePicture:
    """The plane z = 0 from above.

    Attributes:
        color: [G, G, 3] Lab of 8 bit; spread: [G, G, 3] its median deviation.
        known: [G, G] uint8, 1 where views agree.
        light: [V, 3] what each photo is lighter (or redder) by.
        cell_to_pixel: [V, 3, 3] homographies.
        labs: [V, H, W, 3] the blurred photos.
    """

    color: F32
    spread: F32
    known: U8
    light: F64
    cell_to_pixel: F64
    labs: F32

    def evidence(self, view: int) -> U8:
        """Return [H, W] UNKNOWN, TABLE or OBJECT for each pixel of a view."""
        size = self.labs.shape[2], self.labs.shape[1]
        move = _between_centres(self.cell_to_pixel[view])
        expected = cv2.warpPerspective(self.color, move, size) + self.light[view]
        sigma = 1.5 * cv2.warpPerspective(self.spread, move, size) + np.array(NOISE)
        known = cv2.warpPerspective(self.known.astype(np.float32), move, size) > 0.99
        off = np.sqrt((((self.labs[view] - expected) / sigma) ** 2).sum(-1))
        off = cv2.GaussianBlur(off, (0, 0), 1.0)
        other = cv2.morphologyEx((known & (off > OTHER)).astype(np.uint8), cv2.MORPH_OPEN,
                                 np.ones((3, 3), np.uint8))
        return np.where(other > 0, OBJECT, np.where(known & (off < SAME), TABLE, UNKNOWN)
                        ).astype(np.uint8)


def table_picture(views: Views, hidden: U8, half: float, standing: F64,
                  beside: int = 0) -> TablePicture:
    """Return the plane's picture.

    Args:
        views: of one state, in a frame whose z = 0 is the plane.
        hidden: [V, H, W] uint8, 1 where the object is known to stand in front of it.
        half: half the side of the square that is drawn.
        standing: [N, 3] points of the object; below those that are low nothing is known of the
            plane, for an object of one colour looks alike there from all sides.
        beside: cells about them of which nothing is known either.
    """
    cell = np.array([[2 * half / CELLS, 0, -half], [0, 2 * half / CELLS, -half], [0, 0, 1.0]])
    moves = np.stack([(views.K @ view[:3])[:, [0, 1, 3]] @ cell for view in views.viewmats])
    labs = np.stack([cv2.cvtColor(cv2.GaussianBlur(rgb, (0, 0), 1.0), cv2.COLOR_RGB2LAB)
                     for rgb in views.rgb]).astype(np.float32)
    chosen = np.unique(np.linspace(0, len(views) - 1, MOST_VIEWS).astype(int))
    samples = np.stack([_from_above(labs[v], hidden[v], moves[v]) for v in chosen])
    light = _light(samples - _median(samples))
    samples -= light[:, None, None]
    color = _median(samples)
    spread = _median(np.abs(samples - color))
    seen = np.isfinite(samples[..., 0]).sum(0)
    known = (seen >= FEWEST_VIEWS) & (spread < np.array(STEADY)).all(-1)
    known &= ~_below(standing, half, beside)
    every = np.zeros((len(views), 3))
    every[chosen] = light
    picture = TablePicture(np.nan_to_num(color), np.nan_to_num(spread), known.astype(np.uint8),
                           every, moves, labs)
    return _lit(picture, set(map(int, chosen)), hidden)


def seen_on_plane(views: Views, middle: F64) -> list[U8]:
    """Return per view [H, W] 1 where a sweep of planes over neighbouring photos stops at z = 0.

    A window that looks as the neighbours do at the plane, and less so a little above and below,
    lies on it.

    Args:
        views: of one state, in a frame whose z = 0 is the plane.
        middle: [3] what the cameras look at.
    """
    greys = np.stack([cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
                      for rgb in views.rgb]).astype(np.float32)
    away = eyes(views.viewmats) - middle
    radius = float(np.median(np.linalg.norm(away, axis=1)))
    away /= np.linalg.norm(away, axis=1)[:, None]
    apart = np.rad2deg(np.arccos(np.clip(away @ away.T, -1, 1)))
    apart[(apart < BESIDE_DEG[0]) | (apart > BESIDE_DEG[1])] = np.inf
    lenses = np.stack([[_plane_at(views, v, radius * height) for height in HEIGHTS]
                       for v in range(len(views))])

    def told(view: int) -> U8:
        beside = [int(u) for u in np.argsort(apart[view])[:NEIGHBOURS]
                  if np.isfinite(apart[view, u])]
        if len(beside) < AGREEING:
            return np.zeros(views.size, np.uint8)
        match = np.stack([
            np.sort([_correlation(greys[view], greys[u], lenses[u, k] @ np.linalg.inv(here))
                     for u in beside], axis=0)[-AGREEING]
            for k, here in enumerate(lenses[view])])
        plane = (match.argmax(0) == HEIGHTS.index(0.0)) & (match.max(0) > ALIKE)
        # a window that holds an edge of the object may follow the plane beside it
        return np.asarray(cv2.erode(plane.astype(np.uint8), np.ones((WINDOW, WINDOW), np.uint8)))

    return in_threads([partial(told, v) for v in range(len(views))])


def _plane_at(views: Views, view: int, height: float) -> F64:
    """Return [3, 3] from x, y of the plane z = height to pixels of a view."""
    lens = views.K @ views.viewmats[view][:3]
    return np.asarray(np.stack([lens[:, 0], lens[:, 1], lens[:, 3] + height * lens[:, 2]], 1))


def _correlation(one: F32, two: F32, move: F64) -> F32:
    """Return [H, W] how alike windows of one and of two under a homography are, -1 = unknown."""
    size = one.shape[1], one.shape[0]
    moved = cv2.warpPerspective(two, _between_centres(move), size, borderValue=(-1000.0,),
                                flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    mean_one, mean_two = (cv2.blur(image, (WINDOW, WINDOW)) for image in (one, moved))
    own, other, both = (cv2.blur(image, (WINDOW, WINDOW))
                        for image in (one * one, moved * moved, one * moved))
    spread = own - mean_one**2, other - mean_two**2
    alike = ((both - mean_one * mean_two)
             / np.sqrt(np.maximum(spread[0], 1.0) * np.maximum(spread[1], 1.0)))
    return np.where((mean_two < 0) | (spread[0] < PATTERN), -1.0, alike).astype(np.float32)


def _median(samples: F32) -> F32:
    """Return [G, G, 3] the lower median of what views [V, G, G, 3] show, NaN where none does."""
    ordered = np.sort(samples, axis=0)  # NaN last
    count = np.isfinite(ordered).sum(0)
    return np.asarray(np.take_along_axis(ordered, np.maximum(count - 1, 0)[None] // 2, 0)[0])


def _light(off: F32) -> F32:
    """Return [V, 3] by how much each of the views [V, G, G, 3] is lighter, 0 where none tells."""
    flat = off[:, ::3, ::3].reshape(len(off), -1, 3)  # every ninth cell is plenty for one number
    return np.nan_to_num(_median(flat.transpose(1, 0, 2)))


def _below(standing: F64, half: float, beside: int) -> NDArray[np.bool_]:
    """Return [G, G] the cells below low points, and those beside them."""
    out = np.zeros((CELLS, CELLS), np.uint8)
    low = standing[standing[:, 2] < LOW * half]
    x, y = np.clip((low[:, :2] + half) / (2 * half) * CELLS, 0, CELLS - 1).astype(int).T
    out[y, x] = 1
    return cv2.dilate(out, np.ones((2 * beside + 1,) * 2, np.uint8)) > 0


def _lit(picture: TablePicture, done: set[int], hidden: U8) -> TablePicture:
    """Return the picture with the light of the photos that the median was not taken of."""
    light = picture.light.copy()
    for v in range(len(light)):
        if v not in done:
            sample = _from_above(picture.labs[v], hidden[v], picture.cell_to_pixel[v])
            sample[picture.known == 0] = np.nan
            light[v] = _light((sample - picture.color)[None])[0]
    return TablePicture(picture.color, picture.spread, picture.known, light,
                        picture.cell_to_pixel, picture.labs)


def _between_centres(move: F64) -> F64:
    """Return a homography between +0.5 pixel centres for OpenCV, which counts centres as whole."""
    shift = np.array([[1.0, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])
    return np.asarray(shift @ move @ np.linalg.inv(shift))


def _from_above(lab: F32, hidden: U8, move: F64) -> F32:
    """Return [G, G, 3] what a photo shows of the plane, NaN where it does not."""
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    centred = _between_centres(move)
    out = cv2.warpPerspective(lab, centred, (CELLS, CELLS), flags=flags)
    clear = cv2.warpPerspective(1 - hidden, centred, (CELLS, CELLS),
                                flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)
    y, x = np.mgrid[0:CELLS, 0:CELLS] + 0.5
    ahead = move[2, 0] * x + move[2, 1] * y + move[2, 2] > 0
    out[(clear == 0) | ~ahead] = np.nan
    return np.asarray(out, np.float32)
