"""Segments: straight edges in the photos, to a few hundredths of a pixel.

Found by OpenCV's line segment detector (Grompone von Gioi et al. 2012), then moved to where the
brightness changes most; both ends of a long edge are known better than any surface fitted to it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F32, F64
from part2gs_robotics.model.scene import StateViews

LEAST = 20.0  # pixels: the direction of a shorter one is known to half a degree at best
REACH = 3.5  # pixels across a segment that are looked at
STEP = 0.5  # pixels between them
BLUR = 0.7  # pixels, of the photo: aliased edges are stairs
WIDTH = 1.5  # pixels: brightness changes farther from the segment are another edge's
FAINT = 4.0  # of 255: a smaller change is noise
ENDS = 2.0  # pixels at both ends that are left out: corners bend there
POINTS = 12  # of a segment that must show an edge
ROUNDS = 5  # of reweighting its line
FINEST = 0.03  # pixels: no edge is straighter than that on a grid
PASSES = 2  # of moving: where one looks first draws an edge by a twelfth of a pixel
FAR = 2.0  # pixels: moved farther, it is another edge


@dataclass(frozen=True)
class Segments:
    """N straight edges in the photos of one state.

    Attributes:
        ends: [N, 2, 2] pixels (x, y), pixel centres at +0.5.
        views: [N] which camera saw it.
        Ks: [V, 3, 3].  viewmats: [V, 4, 4] camera_from_world.
    """

    ends: F64
    views: NDArray[np.int64]
    Ks: F64
    viewmats: F64

    def select(self, index: NDArray[np.bool_]) -> Segments:
        """Return the segments picked by a mask."""
        return Segments(self.ends[index], self.views[index], self.Ks, self.viewmats)

    def __len__(self) -> int:
        """Number of segments."""
        return len(self.ends)


def segments_of(state: StateViews) -> Segments:
    """Return the straight edges of a state's training photos."""
    found, views = [np.zeros((0, 2, 2))], [np.zeros(0, np.int64)]
    for v in np.flatnonzero(~state.held_out):
        gray = _gray(state.images[v], state.alphas[v])
        ends, soft = _detected(gray), cv2.GaussianBlur(gray, (0, 0), BLUR)
        for _ in range(PASSES):
            ends = _sharpened(ends, soft)
        found.append(ends)
        views.append(np.full(len(ends), v))
    return Segments(np.concatenate(found), np.concatenate(views), state.Ks, state.viewmats)


def _gray(image: NDArray[np.uint8], alpha: NDArray[np.uint8]) -> F32:
    """Return [H, W] 0..255, the object over black or white, whichever it stands out from."""
    share = alpha.astype(np.float32) / 255
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
    bright = float((gray * share).sum()) > 127.5 * float(share.sum())
    return np.asarray(gray * share + (0.0 if bright else 255.0) * (1 - share), np.float32)


def _detected(gray: F32) -> F64:
    """Return [N, 2, 2] ends of the segments that are long enough."""
    detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD)
    lines = detector.detect(np.clip(gray, 0, 255).astype(np.uint8))[0]
    if lines is None:
        return np.zeros((0, 2, 2))
    ends = lines.reshape(-1, 2, 2).astype(np.float64) + 0.5  # OpenCV counts from a pixel's centre
    return np.asarray(ends[np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > LEAST])


def _sharpened(ends: F64, gray: F32) -> F64:
    """Return the segments moved onto the edge of the photo; those without a clear one are left out.

    Args:
        ends: [N, 2, 2] pixels.
        gray: [H, W] 0..255, a little blurred.
    """
    if not len(ends):
        return ends
    ways = ends[:, 1] - ends[:, 0]
    lengths = np.linalg.norm(ways, axis=1)
    ways /= lengths[:, None]
    across = np.stack([-ways[:, 1], ways[:, 0]], 1)
    counts = (lengths - 2 * ENDS).astype(int)
    which = np.repeat(np.arange(len(ends)), counts)
    along = ENDS + np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    points = ends[which, 0] + along[:, None] * ways[which]
    height, seen = _crossings(gray, points, across[which], which, len(ends))
    lines = _lines(which[seen], along[seen] / lengths[which[seen]], height[seen], len(ends))
    moved = ends + lines[:, :, None] * across[:, None]
    clear = np.bincount(which[seen], minlength=len(ends)) >= POINTS
    return np.asarray(moved[clear & (np.abs(lines).max(1) < FAR)])


def _crossings(gray: F32, points: F64, across: F64, which: NDArray[np.int64], count: int,
               ) -> tuple[F64, NDArray[np.bool_]]:
    """Return [P] pixels from points to the edge beside them, and whether there is a clear one."""
    offsets = np.arange(-REACH, REACH + STEP / 2, STEP)
    at = (points[:, None] + offsets[:, None] * across[:, None] - 0.5).astype(np.float32)
    profile = cv2.remap(gray, at[..., 0], at[..., 1], cv2.INTER_LINEAR,
                        borderMode=cv2.BORDER_REPLICATE)
    change = np.diff(profile, axis=1).astype(np.float64)
    middle = (offsets[1:] + offsets[:-1]) / 2
    near = change[:, np.abs(middle) < 1.0].sum(1)
    side = np.sign(np.bincount(which, near, count))[which]  # an edge is brighter on one side
    weight = np.maximum(side[:, None] * change, 0) * np.exp(-((middle / WIDTH) ** 2))
    total = weight.sum(1)
    return weight @ middle / np.maximum(total, 1e-9), total > FAINT


def _lines(which: NDArray[np.int64], along: F64, height: F64, count: int) -> F64:
    """Return [N, 2] heights at both ends of the robust line through every segment's points.

    Args:
        which: [P] segment of every point.
        along: [P] 0..1 from the first end to the second.
        height: [P] pixels.
        count: number of segments.
    """
    def sums(values: F64) -> F64:
        return np.asarray(np.bincount(which, values, count), np.float64)

    weight, lines = np.ones(len(which)), np.zeros((count, 2))
    for _ in range(ROUNDS):
        s, x, xx = sums(weight), sums(weight * along), sums(weight * along**2)
        y, xy = sums(weight * height), sums(weight * along * height)
        slope = (s * xy - x * y) / np.maximum(s * xx - x * x, 1e-9)
        first = (y - slope * x) / np.maximum(s, 1e-9)
        lines = np.stack([first, first + slope], 1)
        gap = np.abs(height - first[which] - slope[which] * along)
        scale = np.maximum(2 * sums(gap) / np.maximum(sums(np.ones_like(gap)), 1), 2 * FINEST)
        weight = 1 / (1 + (gap / scale[which]) ** 2) ** 2
    return lines
