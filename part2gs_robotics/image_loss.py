"""Image losses with analytic gradients: L1 + D-SSIM of two images, in numpy and OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.render_jit import kernel

Floats = NDArray[np.floating]

WINDOW, SIGMA = 11, 1.5  # Wang et al. 2004, as in 3DGS
C1, C2 = 0.01**2, 0.03**2  # for a colour range of 1
RADIUS = WINDOW // 2


def photometric(image: NDArray[np.floating], target: NDArray[np.floating],
                dssim_weight: float = 0.2) -> tuple[float, NDArray[np.floating]]:
    """Return (1 - w) L1 + w (1 - SSIM) of two images, and its gradient by the first.

    Args:
        image: [H, W, C] float32 or float64 in [0, 1].
        target: like image, constant.
        dssim_weight: w; 0.2 in 3DGS.

    Returns:
        The loss (mean over pixels and channels) and its gradient [H, W, C].
    """
    if dssim_weight == 0.0:
        diff = image - target
        return float(np.abs(diff).mean()), np.sign(diff) / diff.size
    mean_x, mean_y = _blur(image), _blur(target)
    xx, yy, xy = _blur(image * image), _blur(target * target), _blur(image * target)
    by_mean, by_xx, by_xy = np.zeros_like(xx), np.zeros_like(xx), np.zeros_like(xx)
    total = _ssim(mean_x.ravel(), mean_y.ravel(), xx.ravel(), yy.ravel(), xy.ravel(),
                  by_mean.ravel(), by_xx.ravel(), by_xy.ravel())
    # The blur with zero borders is its own transpose, so gradients go back through the same blur.
    by_mean, by_xx, by_xy = _blur(by_mean), _blur(by_xx), _blur(by_xy)
    grad = np.zeros_like(image)
    l1 = _combine(image.ravel(), target.ravel(), by_mean.ravel(), by_xx.ravel(), by_xy.ravel(),
                  (1 - dssim_weight) / image.size, dssim_weight / image.size, grad.ravel())
    loss = (1 - dssim_weight) * l1 / image.size + dssim_weight * (1 - total / image.size)
    return float(loss), grad


def ssim(image: NDArray[np.floating], target: NDArray[np.floating]) -> float:
    """Return the mean structural similarity of two [H, W, C] images in [0, 1]."""
    loss, _ = photometric(image, target, 1.0)
    return 1.0 - loss


def psnr(image: NDArray[np.floating], target: NDArray[np.floating]) -> float:
    """Return the peak signal-to-noise ratio in dB of two images in [0, 1]."""
    error = float(np.mean((np.asarray(image, np.float64) - target) ** 2))
    return float(-10 * np.log10(max(error, 1e-12)))


def _blur(image: NDArray[np.floating]) -> NDArray[np.floating]:
    """Blur with the SSIM window, zero outside the image, like a zero-padded convolution."""
    out = cv2.GaussianBlur(image, (WINDOW, WINDOW), SIGMA, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(out).reshape(image.shape)


@kernel
def _ssim(mx: Floats, my: Floats, xx: Floats, yy: Floats, xy: Floats, by_mean: Floats,
          by_xx: Floats, by_xy: Floats) -> float:
    """Return the sum of SSIM and fill its derivatives by the blurred x, x^2 and x y."""
    total = 0.0
    for i in range(mx.size):
        a, b = mx[i], my[i]
        top1, top2 = 2 * a * b + C1, 2 * (xy[i] - a * b) + C2
        low1, low2 = a * a + b * b + C1, xx[i] - a * a + yy[i] - b * b + C2
        s = top1 * top2 / (low1 * low2)
        total += s
        by_xy[i] = 2 * top1 / (low1 * low2)
        by_xx[i] = -s / low2
        by_mean[i] = 2 * b * (top2 - top1) / (low1 * low2) - 2 * a * s / low1 + 2 * a * s / low2
    return total


@kernel
def _combine(image: Floats, target: Floats, by_mean: Floats, by_xx: Floats, by_xy: Floats,
             w_l1: float, w_ssim: float, grad: Floats) -> float:
    total = 0.0
    for i in range(image.size):
        d = image[i] - target[i]
        total += abs(d)
        sign = 1.0 if d > 0 else (-1.0 if d < 0 else 0.0)
        by_x = by_mean[i] + 2 * image[i] * by_xx[i] + target[i] * by_xy[i]
        grad[i] = w_l1 * sign - w_ssim * by_x
    return total
