"""Lenses of COLMAP's camera models: where a ray of a pinhole camera falls on the distorted photo.

Formulas and order of parameters: COLMAP, src/colmap/sensor/models.h.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from part2gs_robotics.model.arrays import F64

Rays = tuple[F64, F64]
Distort = Callable[[Rays, tuple[float, ...]], Rays]

BORDER = 64  # samples per side of the new image's border: a lens is smooth between them
WIDEST, NARROWEST = 0.1, 3.0  # new focal length per old one: above 3 a ninth of a photo is left
HALVINGS = 40  # of that range: far below a pixel


class Lens:
    """A lens and what its focal length and centre are, in pixels.

    Attributes:
        distort: rays on the plane z = 1 and parameters to distorted places, both unit focal length.
    """

    def __init__(self, K: F64, model: str, params: tuple[float, ...]) -> None:
        """Remember the lens.

        Args:
            K: [3, 3] pixels, pixel centres at +0.5.
            model: COLMAP's name, a key of `LENSES`.
            params: its parameters behind focal length and centre.
        """
        self.K, self.params = K, params
        self.distort = LENSES[model][1]

    def pixels(self, rays: F64) -> F64:
        """Return the places [N, 2] on the distorted photo of rays [N, 2] on the plane z = 1."""
        u, v = self.distort((rays[:, 0], rays[:, 1]), self.params)
        return np.stack([u * self.K[0, 0] + self.K[0, 2], v * self.K[1, 1] + self.K[1, 2]], 1)

    def fitting(self, size: tuple[int, int]) -> F64 | None:
        """Return K [3, 3] of the widest pinhole photo without invalid pixels, None if none fits.

        Its centre is the lens's own.
        """
        low, high = np.log(WIDEST), np.log(NARROWEST)
        if not self._covers(float(np.exp(high)), size):
            return None
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            covers = self._covers(float(np.exp(middle)), size)
            low, high = (low, middle) if covers else (middle, high)
        return self._scaled(float(np.exp(high)))

    def maps(self, new_K: F64, size: tuple[int, int]) -> tuple[F64, F64]:
        """Return for every pixel of the new photo the column and row [H, W] of the old one."""
        grid = np.stack(np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5), -1)
        found = self.pixels(_rays(new_K, grid.reshape(-1, 2))).reshape(*grid.shape) - 0.5
        return found[..., 0], found[..., 1]  # cv2.remap counts from pixel centres at integers

    def _scaled(self, factor: float) -> F64:
        return np.asarray(np.diag([factor, factor, 1.0]) @ self.K
                          + (1 - factor) * np.pad(self.K[:2, 2:], ((0, 1), (2, 0))))

    def _covers(self, factor: float, size: tuple[int, int]) -> bool:
        """Tell whether the border and its way from the centre fall inside the photo, unfolded."""
        width, height = size
        along = np.linspace(0, 1, BORDER)
        edge = np.concatenate([np.stack([along * width, np.full(BORDER, y)], 1)
                               for y in (0.0, height)]
                              + [np.stack([np.full(BORDER, x), along * height], 1)
                                 for x in (0.0, width)])
        rays = _rays(self._scaled(factor), edge)
        with np.errstate(all="ignore"):  # outside of the lens there are roots of negative numbers
            at = self.pixels(rays)
            inner = self.pixels(0.98 * rays)
        middle = self.K[:2, 2]
        inside = (at >= 0) & (at <= [width, height])
        outward = ((at - inner) * (inner - middle)).sum(1) > 0  # else rays fold back upon others
        return bool(inside.all() and outward.all())


def _rays(K: F64, pixels: F64) -> F64:
    return np.asarray((pixels - K[:2, 2]) / np.diag(K)[:2])


def _radial(rays: Rays, k: tuple[float, ...]) -> Rays:
    """Polynomial in r squared."""
    r2 = rays[0] ** 2 + rays[1] ** 2
    factor = 1.0 + sum(c * r2 ** (i + 1) for i, c in enumerate(k))
    return rays[0] * factor, rays[1] * factor


def _tangential(rays: Rays, p1: float, p2: float) -> Rays:
    """What a decentred lens adds."""
    x, y = rays
    r2 = x * x + y * y
    return (2 * p1 * x * y + p2 * (r2 + 2 * x * x), 2 * p2 * x * y + p1 * (r2 + 2 * y * y))


def _opencv(rays: Rays, p: tuple[float, ...]) -> Rays:
    (x, y), (dx, dy) = _radial(rays, p[:2]), _tangential(rays, p[2], p[3])
    return x + dx, y + dy


def _full_opencv(rays: Rays, p: tuple[float, ...]) -> Rays:
    k1, k2, p1, p2, k3, k4, k5, k6 = p
    r2 = rays[0] ** 2 + rays[1] ** 2
    factor = ((1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3)
              / (1.0 + k4 * r2 + k5 * r2**2 + k6 * r2**3))
    dx, dy = _tangential(rays, p1, p2)
    return rays[0] * factor + dx, rays[1] * factor + dy


def _angles(rays: Rays) -> Rays:
    """Rays as an equidistant fisheye sees them: the angle to the axis in place of its tangent."""
    r = np.hypot(*rays)
    factor = np.arctan(r) / np.maximum(r, 1e-12)
    factor = np.where(r < 1e-9, 1.0, factor)
    return rays[0] * factor, rays[1] * factor


def _fisheye(rays: Rays, k: tuple[float, ...]) -> Rays:
    return _radial(_angles(rays), k)


def _fov(rays: Rays, p: tuple[float, ...]) -> Rays:
    """Devernay and Faugeras: straight lines have to be straight."""
    r, omega = np.hypot(*rays), p[0]
    if abs(omega) < 1e-6:  # the limit of the formula: no distortion
        return rays
    factor = np.arctan(r * 2 * np.tan(omega / 2)) / (np.maximum(r, 1e-12) * omega)
    factor = np.where(r < 1e-9, 2 * np.tan(omega / 2) / omega, factor)
    return rays[0] * factor, rays[1] * factor


def _thin_prism(rays: Rays, p: tuple[float, ...]) -> Rays:
    k1, k2, p1, p2, k3, k4, s1, s2 = p
    seen = _angles(rays)
    (x, y), (dx, dy) = _radial(seen, (k1, k2, k3, k4)), _tangential(seen, p1, p2)
    r2 = seen[0] ** 2 + seen[1] ** 2
    return x + dx + s1 * r2, y + dy + s2 * r2


def _rad_tan_thin_prism(rays: Rays, p: tuple[float, ...]) -> Rays:
    x, y = _radial(_angles(rays), p[:6])
    dx, dy = _tangential((x, y), p[7], p[6])
    r2 = x * x + y * y
    s0, s1, s2, s3 = p[8:]
    return x + dx + s0 * r2 + s1 * r2**2, y + dy + s2 * r2 + s3 * r2**2


def _division(rays: Rays, p: tuple[float, ...]) -> Rays:
    """Fitzgibbon: the undistorted radius is the distorted one over 1 + k r squared."""
    r2 = rays[0] ** 2 + rays[1] ** 2
    factor = 2.0 / (1.0 + np.sqrt(1.0 - 4.0 * p[0] * r2))
    return rays[0] * factor, rays[1] * factor


def _eucm(rays: Rays, p: tuple[float, ...]) -> Rays:
    """Khomutenko, Garcia and Martinet: the enhanced unified camera model."""
    alpha, beta = p
    below = alpha * np.sqrt(beta * (rays[0] ** 2 + rays[1] ** 2) + 1.0) + 1.0 - alpha
    return rays[0] / below, rays[1] / below


# Model -> (focal lengths among its parameters, distortion), in the order of COLMAP's ids.
LENSES: dict[str, tuple[int, Distort]] = {
    "SIMPLE_PINHOLE": (1, _radial), "PINHOLE": (2, _radial), "SIMPLE_RADIAL": (1, _radial),
    "RADIAL": (1, _radial), "OPENCV": (2, _opencv), "OPENCV_FISHEYE": (2, _fisheye),
    "FULL_OPENCV": (2, _full_opencv), "FOV": (2, _fov), "SIMPLE_RADIAL_FISHEYE": (1, _fisheye),
    "RADIAL_FISHEYE": (1, _fisheye), "THIN_PRISM_FISHEYE": (2, _thin_prism),
    "RAD_TAN_THIN_PRISM_FISHEYE": (2, _rad_tan_thin_prism), "SIMPLE_DIVISION": (1, _division),
    "DIVISION": (2, _division), "SIMPLE_FISHEYE": (1, _fisheye), "FISHEYE": (2, _fisheye),
    "EUCM": (2, _eucm)}
COUNTS: dict[str, int] = dict(zip(LENSES, (3, 4, 4, 5, 8, 8, 12, 5, 4, 5, 12, 16, 4, 5, 3, 4, 6),
                                  strict=True))  # of parameters, focal length and centre included


def split(model: str, params: tuple[float, ...]) -> tuple[tuple[float, float, float, float],
                                                          tuple[float, ...]]:
    """Return fx, fy, cx, cy and the lens's own parameters."""
    focals = LENSES[model][0]
    fx, fy = params[0], params[focals - 1]
    cx, cy = params[focals:focals + 2]
    return (fx, fy, cx, cy), params[focals + 2:]


def distorts(model: str, own: tuple[float, ...]) -> bool:
    """Tell whether photos of that lens differ from those of a pinhole."""
    return any(own) or "FISHEYE" in model  # angles differ from tangents whatever is added
