"""Visual hull: silhouettes of one state -> a signed distance grid -> coloured surface points."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import FitError
from part2gs_robotics.model.arrays import F32, F64
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel

Floats = NDArray[np.floating]

BLOCK = 4  # fine voxels per coarse block and axis: 48^3 blocks decide most of a 192^3 grid
BAND = 2.0  # voxels: the signed distance is exact within this band and clipped outside
MIN_SEEN = 2  # one silhouette alone cannot bound a voxel
SEEN_SHARE = 4  # a voxel seen by less than a quarter of the views lies off the scene's middle
FORGIVE_EVERY = 16  # one wrong mask is forgiven per so many views that see a voxel
BAD_VIEW = 0.25  # a mask that rejects this share more of the object than the median mask is broken


@dataclass(frozen=True)
class Hull:
    """A visual hull as a sampled signed distance, in the world frame.

    Attributes:
        lo: [3] float64, centre of voxel (0, 0, 0), scene units.
        voxel: edge length, scene units.
        values: [X, Y, Z] float32 approximate signed distance, positive inside, scene units,
            clipped to BAND voxels.
        views_used: [V] bool, False = the mask was rejected as broken.
    """

    lo: F64
    voxel: float
    values: F32
    views_used: NDArray[np.bool_]

    @property
    def occupancy(self) -> NDArray[np.bool_]:
        """[X, Y, Z] True inside."""
        return self.values > 0

    @property
    def hi(self) -> F64:
        """[3] centre of the last voxel."""
        return np.asarray(self.lo + self.voxel * (np.array(self.values.shape) - 1))

    @property
    def diagonal(self) -> float:
        """Diagonal of the occupied box, scene units."""
        index = np.argwhere(self.occupancy)
        return float(np.linalg.norm((np.ptp(index, axis=0) + 1) * self.voxel))

    def sample(self, points: NDArray[np.floating]) -> F32:
        """Return [N] trilinear signed distances at [N, 3] world points; outside the grid -BAND."""
        out = np.zeros(len(points), np.float32)
        _sample(self.values, (np.asarray(points, float) - self.lo) / self.voxel,
                -BAND * self.voxel, out)
        return out


def carve(state: StateViews, bounds: tuple[F64, F64] | None = None, resolution: int = 192,
          outside_votes: int = 2) -> Hull:
    """Carve the visual hull of a state from its masks.

    A voxel is outside when at least `outside_votes` views that see it say so (one view suffices
    where fewer than 16 see it), and when fewer than a quarter of the views see it. Masks that
    contradict all others are left out.

    Args:
        state: posed views; pixels with alpha >= 128 are object.
        bounds: (lo, hi) [3] corners in the world frame; None = found from the silhouettes.
        resolution: voxels along the longest side.
        outside_votes: 1 = the exact hull, 2 = one wrong mask per voxel is forgiven.

    Raises:
        FitError: the masks are empty or their cones do not meet.
    """
    masks = (state.alphas >= 128).astype(np.uint8)
    cams = np.concatenate([state.Ks @ state.viewmats[:, :3]], axis=0)  # [V, 3, 4] projections
    dist = np.stack([_signed_distance(a) for a in state.alphas])
    used = np.array([mask.any() for mask in masks])
    if used.sum() < MIN_SEEN:
        raise FitError(f"{int(used.sum())} of {len(masks)} masks show the object. Needed at least "
                       f"{MIN_SEEN} views with alpha; check the alpha channel or masks/ folder.")
    lo, hi = bounds if bounds is not None else _first_box(state, masks, used)
    used &= _consistent(lo, hi, cams, dist, used)
    votes = min(outside_votes, max(1, int(used.sum()) // 3))
    if bounds is None:
        lo, hi = _shrink(lo, hi, cams[used], dist[used], votes)
    voxel = float((hi - lo).max() / resolution)
    values = _grid(lo, hi, voxel, cams[used], dist[used], votes)
    if not (values > 0).any():
        raise FitError(f"The silhouettes of {int(used.sum())} views have no common volume. Needed "
                       "cameras and masks of one still object in one frame; check the poses.")
    return Hull(lo + voxel / 2, voxel, values, used)


def _signed_distance(alpha: NDArray[np.uint8]) -> F32:
    """Return signed pixel distances to the outline, positive inside, sub-pixel from the alpha."""
    inside = (alpha >= 128).astype(np.uint8)
    if inside.all() or not inside.any():
        return np.full(alpha.shape, 1e4 if inside.all() else -1e4, np.float32)
    d_in = cv2.distanceTransform(inside, cv2.DIST_L2, 5)
    d_out = cv2.distanceTransform(1 - inside, cv2.DIST_L2, 5)
    out = np.where(inside > 0, d_in - 0.5, 0.5 - d_out)
    edge = (alpha > 0) & (alpha < 255) & (np.abs(out) < 1)
    out[edge] = alpha[edge] / 255.0 - 0.5  # covered share of the pixel = offset of a straight edge
    return out.astype(np.float32)


def _first_box(state: StateViews, masks: NDArray[np.uint8], used: NDArray[np.bool_],
               ) -> tuple[F64, F64]:
    """Return a cube around the point nearest to all silhouette centre rays."""
    a, b, radii, eyes = np.zeros((3, 3)), np.zeros(3), [], []
    rays = []
    for v in np.flatnonzero(used):
        ys, xs = np.nonzero(masks[v])
        mid = np.array([(xs.min() + xs.max() + 1) / 2, (ys.min() + ys.max() + 1) / 2, 1.0])
        rot, trans = state.viewmats[v, :3, :3], state.viewmats[v, :3, 3]
        ray = rot.T @ (np.linalg.inv(state.Ks[v]) @ mid)
        ray /= np.linalg.norm(ray)
        eye = -rot.T @ trans
        proj = np.eye(3) - np.outer(ray, ray)
        a, b = a + proj, b + proj @ eye
        rays.append(ray)
        eyes.append(eye)
        radii.append(0.5 * np.hypot(np.ptp(xs) + 1, np.ptp(ys) + 1) / state.Ks[v, 0, 0])
    # The ridge keeps parallel rays solvable; it moves the centre by less than 1e-6 of the scene.
    centre = np.linalg.solve(a + 1e-6 * np.eye(3), b + 1e-6 * np.mean(eyes, axis=0))
    depth = np.array([(centre - e) @ r for e, r in zip(eyes, rays, strict=True)])
    half = 1.3 * float(np.percentile(np.array(radii) * np.maximum(depth, 1e-9), 90))
    return centre - half, centre + half


def _consistent(lo: F64, hi: F64, cams: F64, dist: F32, used: NDArray[np.bool_],
                ) -> NDArray[np.bool_]:
    """Return which masks agree with a coarse hull that forgives a tenth of the views."""
    if used.sum() < 8:  # too few views to outvote one
        return used
    side = np.linspace(0, 1, 40)
    unit = np.stack(np.meshgrid(side, side, side, indexing="ij"), -1).reshape(-1, 3)
    points = lo + unit * (hi - lo)
    inside, seen = (np.zeros((len(cams), len(points)), bool) for _ in range(2))
    _vote(points, cams, dist, inside, seen)
    outside = (seen & ~inside)[used].sum(0)
    core = (outside <= max(1, used.sum() // 10)) & (seen[used].sum(0) >= MIN_SEEN)
    rejects = (seen & ~inside)[:, core].mean(1) if core.any() else np.zeros(len(cams))
    return np.asarray(rejects < np.median(rejects[used]) + BAD_VIEW)


def _shrink(lo: F64, hi: F64, cams: F64, dist: F32, votes: int) -> tuple[F64, F64]:
    """Return the box of the coarse hull; grows first while the hull touches a side."""
    for _ in range(4):  # each round grows by half: four cover a first guess five times too small
        voxel = float((hi - lo).max() / 64)
        index = np.argwhere(_grid(lo, hi, voxel, cams, dist, votes) > -0.5 * voxel)
        if not len(index):
            return lo, hi
        low, high = index.min(0), index.max(0)
        size = np.ceil((hi - lo) / voxel).astype(int)
        if (low > 0).all() and (high < size - 1).all():
            return lo + voxel * (low - 0.5), lo + voxel * (high + 1.5)
        mid, half = (lo + hi) / 2, 0.75 * (hi - lo)
        lo, hi = mid - half, mid + half
    return lo, hi


def _grid(lo: F64, hi: F64, voxel: float, cams: F64, dist: F32, votes: int) -> F32:
    """Return signed distances of all voxels, block by block."""
    size = np.maximum(1, np.ceil((hi - lo) / voxel - 1e-9).astype(np.int64))
    values = np.full(tuple(size), -BAND * voxel, np.float32)
    _carve_blocks(values, lo + voxel / 2, voxel, cams, dist, votes)
    return values


@kernel
def _vote(points: Floats, cams: Floats, dist: Floats, inside: NDArray[np.bool_],
          seen: NDArray[np.bool_]) -> None:
    for_each(len(cams), _vote_at, (points, cams, dist, inside, seen))


@inlined
def _vote_at(v: int, points: Floats, cams: Floats, dist: Floats, inside: NDArray[np.bool_],
             seen: NDArray[np.bool_]) -> None:
    for i in range(len(points)):
        d, _ = _look(cams[v], dist[v], points[i, 0], points[i, 1], points[i, 2])
        seen[v, i] = d > -1e5
        inside[v, i] = d > 0.0


@inlined
def _look(cam: Floats, dist: Floats, x: float, y: float, z: float) -> tuple[float, float]:
    """Return (signed pixel distance, -1e6 unseen; z-depth) of a point in one view."""
    w = cam[2, 0] * x + cam[2, 1] * y + cam[2, 2] * z + cam[2, 3]
    if w <= 1e-9:
        return -1e6, w
    u = (cam[0, 0] * x + cam[0, 1] * y + cam[0, 2] * z + cam[0, 3]) / w - 0.5
    v = (cam[1, 0] * x + cam[1, 1] * y + cam[1, 2] * z + cam[1, 3]) / w - 0.5
    height, width = dist.shape
    if u < -0.5 or v < -0.5 or u > width - 0.5 or v > height - 0.5:
        return -1e6, w
    u = min(max(u, 0.0), width - 1.001)
    v = min(max(v, 0.0), height - 1.001)
    i, j = int(v), int(u)
    fu, fv = u - j, v - i
    top = dist[i, j] * (1 - fu) + dist[i, j + 1] * fu
    low = dist[i + 1, j] * (1 - fu) + dist[i + 1, j + 1] * fu
    return top * (1 - fv) + low * fv, w


@inlined
def _hull_distance(cams: Floats, dist: Floats, focal: Floats, x: float, y: float, z: float,
                   votes: int, floor: float, low: Floats) -> float:
    """Return the votes-th smallest signed distance over the seeing views; any value < floor."""
    low[:] = 1e6
    seen = 0
    for v in range(len(cams)):
        d, w = _look(cams[v], dist[v], x, y, z)
        if d <= -1e5:
            continue
        seen += 1
        d *= w / focal[v]
        k = votes - 1
        if d < low[k]:
            while k > 0 and low[k - 1] > d:
                low[k] = low[k - 1]
                k -= 1
            low[k] = d
            if low[votes - 1] < floor:
                return low[votes - 1]
    if seen < max(MIN_SEEN, len(cams) // SEEN_SHARE):
        return -1e6
    return low[min(votes - 1, seen // FORGIVE_EVERY)]


@kernel
def _carve_blocks(values: Floats, first: Floats, voxel: float, cams: Floats, dist: Floats,
                  votes: int) -> None:
    nx, ny, nz = values.shape
    bx, by, bz = (nx + BLOCK - 1) // BLOCK, (ny + BLOCK - 1) // BLOCK, (nz + BLOCK - 1) // BLOCK
    focal = np.zeros(len(cams))
    for v in range(len(cams)):  # |row 0| of K [R|t] mixes f and cx; f = its part across row 2
        a, c = cams[v, 0], cams[v, 2]
        along = a[0] * c[0] + a[1] * c[1] + a[2] * c[2]
        focal[v] = np.sqrt(max(a[0] ** 2 + a[1] ** 2 + a[2] ** 2 - along**2, 1e-12))
    band = BAND * voxel
    reach = 0.5 * np.sqrt(3.0) * BLOCK * voxel + band
    for_each(bx * by * bz, _carve_blocks_at, (values, first, voxel, cams, dist, votes, nx, ny, nz,
                                              by, bz, focal, band, reach))


@inlined
def _carve_blocks_at(b: int, values: Floats, first: Floats, voxel: float, cams: Floats,
                     dist: Floats, votes: int, nx: int, ny: int, nz: int, by: int, bz: int,
                     focal: Floats, band: float, reach: float) -> None:
    low = np.zeros(votes)
    i0, j0, k0 = b // (by * bz) * BLOCK, b // bz % by * BLOCK, b % bz * BLOCK
    half = (BLOCK - 1) / 2.0
    d = _hull_distance(cams, dist, focal, first[0] + voxel * (i0 + half),
                       first[1] + voxel * (j0 + half), first[2] + voxel * (k0 + half),
                       votes, -1.3 * reach, low)
    # A pixel distance turned into length changes by up to ~1.2 times the step near the frame
    # corner and with depth across the block; the block test keeps that much in reserve.
    decided = abs(d) > 1.2 * reach and d > -1e5
    for i in range(i0, min(i0 + BLOCK, nx)):
        for j in range(j0, min(j0 + BLOCK, ny)):
            for k in range(k0, min(k0 + BLOCK, nz)):
                if decided:
                    values[i, j, k] = band if d > 0 else -band
                else:
                    e = _hull_distance(cams, dist, focal, first[0] + voxel * i,
                                       first[1] + voxel * j, first[2] + voxel * k, votes, -band,
                                       low)
                    values[i, j, k] = min(max(e, -band), band)


@kernel
def _sample(values: Floats, grid: Floats, outside: float, out: Floats) -> None:
    nx, ny, nz = values.shape
    for n in range(len(grid)):
        x, y, z = grid[n, 0], grid[n, 1], grid[n, 2]
        if not (x >= 0 and y >= 0 and z >= 0 and x <= nx - 1 and y <= ny - 1 and z <= nz - 1):
            out[n] = outside
            continue
        i, j, k = min(int(x), nx - 2), min(int(y), ny - 2), min(int(z), nz - 2)
        fx, fy, fz = x - i, y - j, z - k
        total = 0.0
        for a in range(2):
            for b in range(2):
                for c in range(2):
                    total += (values[i + a, j + b, k + c] * (fx if a else 1 - fx)
                              * (fy if b else 1 - fy) * (fz if c else 1 - fz))
        out[n] = total
