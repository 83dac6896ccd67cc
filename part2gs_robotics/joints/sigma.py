"""Standard deviations of an aligned joint, from the curvature and the errors that are left.

The alignment is an M-estimate: its covariance is A^-1 G A^-T (Huber 1967) with A the derivative of
the gradient that is zero at the joint and G the covariance of that gradient. Neighbouring pixels
and views that show the same surface share its error, so G is no sum over pixels. It is modelled as
pixel noise plus shifts of the surface, smooth over several lengths, as wide as the gradients of
patches of surface are seen to be correlated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.joints.pixels import CHANNELS, CHUNKS, Pixels, patch_sums
from part2gs_robotics.model.arrays import F32, F64
from part2gs_robotics.model.joint import Joint

CELL = 0.125  # side of a patch in spans of the part: some 100 patches, each of several pixels
LENGTHS = (0.15, 0.3, 0.6)  # spans: shorter ones are noise of a patch, longer ones move the part
HELD = 0.25  # of the damping: a direction of less curvature kept 7 % of its first error or more
REAL = 0.25  # of its curvature must be of the images: 0.5 to 1.14 measured on textured parts
REWEIGHTS = 4  # solutions of the moments, each weighed by the one before
LOADED = 0.1  # component of a unit direction that makes a quantity as unknown as the direction
LINEAR = 0.2  # rad or diagonals: an error so large is not described by a curvature


class Patches:
    """Sums over the pixels of every patch of one part's surface, all views of one direction."""

    def __init__(self, means: F32) -> None:
        """Choose the patches' side by the part's [n, 3] means in the target state."""
        self.span = float(2 * np.sqrt(means.astype(np.float64).var(0).sum())) if len(means) else 0.0
        self._keys: list[NDArray[np.int64]] = []
        self._sums: list[tuple[F64, ...]] = []

    def add(self, pixels: Pixels, rates: F64, residual: F64, robust: float) -> None:
        """Add the pixels of one view.

        Args:
            pixels: n of them.
            rates: [P, 4, 4] velocity of a point per unit of each parameter.
            residual: [n, 4] photo less picture.
            robust: colour difference at which a pixel counts a quarter.
        """
        rows, cols, K, view = pixels.rows, pixels.cols, pixels.K, pixels.view
        shifts = np.zeros((3, 4, 4))
        shifts[range(3), range(3), 3] = self.span
        jac = np.zeros((len(rows), CHANNELS, len(rates) + 3))
        moves = np.concatenate([rates, shifts])
        total = np.zeros((CHUNKS, 3, len(moves)))
        pixels.slopes(moves, jac, total)
        jac[:, :3] -= total.sum(0) / len(rows)
        depth = pixels.depth[rows, cols].astype(np.float64)
        local = np.stack([(cols + 0.5 - K[0, 2]) / K[0, 0] * depth,
                          (rows + 0.5 - K[1, 2]) / K[1, 1] * depth, depth], 1)
        world = (local - view[:3, 3]) @ view[:3, :3]
        keys = np.floor(world / max(CELL * self.span, 1e-12)).astype(np.int64)
        patches, index = np.unique(keys, axis=0, return_inverse=True)
        n, p = len(patches), len(rates)
        sums = np.zeros((n, p)), np.zeros((n, p, p)), np.zeros((n, p, p)), np.zeros((n, p, 3))
        patch_sums(jac, residual, robust, index.ravel(), *sums)
        self._keys.append(patches)
        self._sums.append(sums)

    def total(self, weight: float, count: int) -> _Sums:
        """Return the sums of all views, one row per patch, for a direction of some weight."""
        if not self._keys:
            p = count
            return _Sums(np.zeros((0, 3)), np.zeros((0, p)), np.zeros((0, p, p)),
                         np.zeros((0, p, p)), np.zeros((0, p, 3)))
        patches, index = np.unique(np.concatenate(self._keys), axis=0, return_inverse=True)
        out: list[F64] = []
        for name, factor in enumerate((weight, weight, weight**2, weight)):
            rows: F64 = np.concatenate([s[name] for s in self._sums])
            whole = np.zeros((len(patches), *rows.shape[1:]))
            np.add.at(whole, index.ravel(), factor * rows)
            out.append(whole)
        return _Sums((patches * CELL).astype(np.float64), *out)


@dataclass(frozen=True)
class _Sums:
    """Of n patches: places [n, 3] in spans, then what patch_sums adds up."""

    places: F64
    g: F64
    bread: F64
    noise: F64
    pull: F64


def with_sigma(joint: Joint, patches: tuple[Patches, Patches], weights: tuple[float, float],
               ways: F64, diag: float) -> Joint:
    """Return the joint with standard deviations; infinite = unobservable.

    Args:
        joint: aligned.
        patches: of both directions.
        weights: of both directions in the alignment.
        ways: [P, S] observed directions.
        diag: diagonal of the object in scene units.
    """
    unknown = 1.0 - (ways**2).sum(1) > LOADED**2  # what is left of the unit vector is unobserved
    sigma = np.full(len(ways), np.inf)
    if ways.size:
        both = [p.total(w, len(ways)) for p, w in zip(patches, weights, strict=True)]
        variances = np.diag(covariance(both[0], both[1], ways))
        sigma = np.where(unknown, np.inf, np.sqrt(np.maximum(variances, 0.0)))
    turning = joint.kind != "prismatic"
    axis = _observed(float(np.hypot(sigma[0], sigma[1])))
    value = _observed(float(sigma[2])) * (1.0 if turning else diag)
    return replace(
        joint,
        sigma_axis=axis,
        sigma_value=value,
        seen=(axis, value),
        sigma_origin=_observed(float(np.hypot(sigma[3], sigma[4]))) * diag
        if turning else float("nan"),
        sigma_rise=_observed(float(sigma[5])) * diag if joint.kind == "screw" else float("nan"),
    )


def observed_directions(h: F64, damping: float, change: F64, meant: F64) -> F64:
    """Return [P, S] orthonormal directions of the parameters that the images show.

    Args:
        h: [P, P] curvature of the alignment.
        damping: of its steps.
        change: [P, P] how the gradient changed when the parameters did.
        meant: [P, P] how it would change if every slope of the image followed the part.
    """
    values, ways = np.linalg.eigh(h)
    ways = ways[:, values > HELD * damping]
    if not ways.shape[1]:
        return np.asarray(ways)
    values, frame = np.linalg.eigh(ways.T @ meant @ ways)
    if values.min() <= 1e-9 * max(values.max(), 1e-9):
        return np.asarray(ways[:, :0])
    white = frame / np.sqrt(values)
    ratio = white.T @ ways.T @ change @ ways @ white
    shares, turn = np.linalg.eigh(0.5 * (ratio + ratio.T))
    false = ways @ white @ turn[:, shares < REAL]  # directions of parameters, not orthogonal
    if not false.shape[1]:
        return np.asarray(ways)
    left = ways - np.linalg.qr(false)[0] @ (np.linalg.qr(false)[0].T @ ways)
    basis, size, _ = np.linalg.svd(left, full_matrices=False)
    return np.asarray(basis[:, size > 0.5])


def _observed(sigma: float) -> float:
    return sigma if sigma < LINEAR else float("inf")


def covariance(one: _Sums, two: _Sums, ways: F64) -> F64:
    """Return the [P, P] covariance of the parameters along the [P, S] observed directions."""
    names = ("g", "bread", "noise", "pull")
    g, bread, noise, pull = (np.concatenate([getattr(s, n) for s in (one, two)]) for n in names)
    g, pull = g @ ways, np.einsum("npk,ps->nsk", pull, ways)
    bread, noise = (np.einsum("npq,ps,qt->nst", m, ways, ways) for m in (bread, noise))
    values, frame = np.linalg.eigh(0.5 * (bread.sum(0) + bread.sum(0).T))
    if values.min() <= 0:  # more outliers than evidence: no minimum of the robust cost
        return np.diag(np.where((np.abs(ways) > LOADED).any(1), np.inf, 0.0))
    white = frame / np.sqrt(values)  # A^-1 = white white^T: from here on the bread is the identity
    g, pull = g @ white, np.einsum("nsk,st->ntk", pull, white)
    bread, noise = (np.einsum("npq,ps,qt->nst", m, white, white) for m in (bread, noise))
    kernels = _kernels(one.places, two.places)
    models = [(None, noise), *((k, pull) for k in kernels[1:-1])]
    wholes, expected = [], []
    for kernel, root in models:
        if kernel is None:
            row, alike = root, np.diag(np.trace(root, axis1=1, axis2=2))
        else:
            row = root @ np.tensordot(kernel, root, 1).transpose(0, 2, 1)
            flat = root.reshape(len(root), -1)
            alike = kernel * (flat @ flat.T)
        wholes.append(row.sum(0))
        expected.append([_expected(k, alike, row, bread) for k in kernels])
    # A quadratic form of so many independent terms scatters by sqrt(2 / terms) of its mean.
    terms = g.size * len(g) / np.array([k.sum() for k in kernels])
    shares = _shares(np.array(expected).T, kernels, g, terms)
    root = ways @ white
    out = [share * root @ whole @ root.T for share, whole in zip(shares, wholes, strict=True)]
    # What the fit took from the gradients is one term per parameter.
    wide = _widened(np.stack([np.diag(c) for c in out]), terms[: len(out)] - g.shape[1])
    return np.asarray(sum(out) * np.sqrt(np.outer(wide, wide)))


def _widened(variances: F64, freedom: F64) -> F64:
    """Return [P] factors of the variances [M, P] that are themselves estimates.

    Student's 90 % interval over the normal one, freedom of the sum by Satterthwaite (1946).
    """
    from scipy.special import stdtrit

    spread = (variances**2 / np.maximum(freedom, 1.0)[:, None]).sum(0)
    nu = np.maximum(variances.sum(0) ** 2 / np.maximum(spread, 1e-300), 1.0)
    return np.asarray((stdtrit(nu, 0.95) / 1.6449) ** 2)


def _kernels(one: F64, two: F64) -> list[F64]:
    """Return [n, n] correlations of patches: none, over the lengths, and all of one direction.

    The two directions carry Gaussians of different fits to different photos.
    """
    places = np.concatenate([one, two])
    state = np.repeat([0, 1], [len(one), len(two)])
    same = (state[:, None] == state).astype(np.float64)
    gap = ((places[:, None] - places) ** 2).sum(-1)
    smooth = [same * np.exp(-0.5 * gap / length**2) for length in LENGTHS]
    return [np.eye(len(places)), *smooth, same]


def _expected(window: F64, alike: F64, row: F64, bread: F64) -> float:
    """Return the mean of sum_ij window_ij g_i . g_j if the gradients' covariance were a model.

    alike [n, n]: mean of g_i . g_j before the joint was fitted, which took bread_i sum_j g_j from
    each; row [n, P, P]: mean of g_i sum_j g_j^T.
    """
    spread = np.tensordot(window, bread, 1)
    taken = 2 * (spread * row.transpose(0, 2, 1)).sum() - ((spread @ row.sum(0)) * bread).sum()
    return float(np.vdot(window, alike) - taken)


def _shares(expected: F64, kernels: list[F64], g: F64, terms: F64) -> F64:
    """Return the variance of every model: least squares of the moments, none negative."""
    from scipy.optimize import nnls

    seen = np.array([float((k * (g @ g.T)).sum()) for k in kernels])
    # Weighed by the moments of the last solution: by those seen, small ones would count too much.
    mean = np.abs(seen)
    shares = np.zeros(expected.shape[1])
    for _ in range(REWEIGHTS):
        scale = np.sqrt(terms) / np.maximum(mean, 1e-12)
        shares = nnls(expected * scale[:, None], seen * scale)[0]
        mean = expected @ shares
    return np.asarray(shares)
