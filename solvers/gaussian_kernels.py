"""Gaussian kernels of unit area with reflecting walls (method of images), for gases with closed forms."""

from collections.abc import Sequence
from math import pi

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.grid.elementary import exp
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario.vocabulary import Face

FAR = 1e30  # m: position that stands for "no wall"


def walls_along(faces: Sequence[Face], axes: np.ndarray, extent: tuple[float, ...]) -> np.ndarray:
    """Return the lower and upper wall [m] along each axis (rows: unit vectors), (axes, 2); ±FAR where there is no wall.

    faces: faces of the domain that are walls; extent: of the domain [m].
    """
    limits = np.tile([-FAR, FAR], (len(axes), 1))
    for face in faces:
        d, side = "xyz".index(face[0]), int(face[1] == "+")
        for n, axis in enumerate(axes):
            if abs(axis[d]) > 0.5:
                upper = side if axis[d] > 0 else 1 - side
                limits[n, upper] = axis[d] * side * extent[d]
    return limits


@ti.func
def gaussian(q, centre, variance, low, high, most: Template):
    """Return at q a Gaussian of unit area with this centre and variance, mirrored by walls at `low` and `high`.

    most: largest number of walls, 0 to 2. Between two walls a narrow Gaussian is a sum of images, a wide one a cosine
    series (Poisson's formula); both to 1e-7.
    """
    total = 0.0
    if ti.static(most == 0):
        total = _free(q, centre, variance)
    elif ti.static(most == 1):
        total = _before_one(q, centre, variance, low, high)
    else:
        if low > -FAR and high < FAR:
            total = _between_two(q, centre, variance, low, high)
        else:
            total = _before_one(q, centre, variance, low, high)
    return total


@ti.func
def _free(q, centre, variance):
    return exp(-((q - centre) ** 2) / (2.0 * variance)) / ti.sqrt(2.0 * pi * variance)


@ti.func
def _before_one(q, centre, variance, low, high):
    walled = low > -FAR or high < FAR
    wall = ti.select(low > -FAR, low, ti.select(walled, high, 0.0))
    image = exp(-((q - (2.0 * wall - centre)) ** 2) / (2.0 * variance))
    total = exp(-((q - centre) ** 2) / (2.0 * variance)) + ti.select(walled, image, 0.0)
    return total / ti.sqrt(2.0 * pi * variance)


@ti.func
def _between_two(q, centre, variance, low, high):
    total, width = 0.0, high - low
    if variance < 0.25 * width**2:
        near = centre - 2.0 * width * ti.round((centre - low) / (2.0 * width))  # the nearest image
        for m in range(-2, 3):
            image = near + 2.0 * m * width
            total += _free(q, image, variance) + _free(q, 2.0 * low - image, variance)
    else:
        total = 1.0
        for m in range(1, 4):
            k = m * pi / width
            waves = ti.cos(k * (q - low)) * ti.cos(k * (centre - low))
            total += 2.0 * waves * exp(-0.5 * k**2 * variance)
        total /= width
    return total
