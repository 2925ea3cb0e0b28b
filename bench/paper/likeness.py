"""Similarity of two images: PSNR, and SSIM as its authors define it, with windows of 8x8."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
Plane = NDArray[np.float64]

_WINDOW = 8


def psnr(shown: Picture, meant: Picture) -> float:
    """Peak signal-to-noise ratio in decibels; infinite for equal pictures."""
    error = float(np.mean((shown.astype(np.float64) - meant) ** 2))
    return float("inf") if error == 0 else 10 * float(np.log10(255**2 / error))


def ssim(shown: Picture, meant: Picture) -> float:
    """Mean structural similarity of the brightness (Wang et al. 2004), 1 for equal pictures."""
    x, y = _brightness(shown), _brightness(meant)
    mean_x, mean_y = _means(x), _means(y)
    var_x, var_y = _means(x * x) - mean_x**2, _means(y * y) - mean_y**2
    covariance = _means(x * y) - mean_x * mean_y
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    alike = (2 * mean_x * mean_y + c1) * (2 * covariance + c2)
    return float(np.mean(alike / ((mean_x**2 + mean_y**2 + c1) * (var_x + var_y + c2))))


def _brightness(picture: Picture) -> Plane:
    weights = np.array([0.299, 0.587, 0.114])
    brightness: Plane = picture.astype(np.float64) @ weights
    return brightness


def _means(plane: Plane) -> Plane:
    """The mean of every window, by sums over rows and columns."""
    sums = np.pad(plane, ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    n = _WINDOW
    windows: Plane = (sums[n:, n:] - sums[:-n, n:] - sums[n:, :-n] + sums[:-n, :-n]) / n**2
    return windows
