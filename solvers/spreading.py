"""How what is released at a point is spread over the cells around it.

Along an axis, at a place f in [0, 1/2] of the way from the centre of cell 0 to that of cell 1 (beyond, mirrored), cells
-2 to 3 receive the shares w. Linear interpolation, by which robots smell, spreads a value at f with the variance
f (1 - f) [cells²]; w has the rest of 5/6, so that what is smelt of a plume on its axis does not depend on where in a
cell its source sits, however far the plume has spread (within 3 %; the usual shares of the two nearest cells give 4
times as much at a cell's centre as at its corner). No share is negative, and their centroid is f. As in Peskin's
conditions for immersed boundaries (2002, doi:10.1017/S0962492902000077), a few moments determine the shares: four cells
whose centroid is f, whose variance is 1/2 - f (1 - f), and whose interpolate at f is 1/2. They are smoothed by SMOOTHED
on either side. What is below zero then, in the last cell, is taken from its neighbours by a third difference, which
leaves the sum, the centroid and the variance.
"""

import numpy as np

VARIANCE = 5.0 / 6.0
"""Variance [cells²] of the shares and of the linear interpolation by which gas is read, together."""
REACH = 2
"""Cells on either side of the one at or before the point, and one more beyond it."""
SMOOTHED = 1.0 / 6.0
"""Measured: of thinner plumes weno5, of wider ones koren misses more of the way that the wind goes across the grid."""


def shares(f: float) -> np.ndarray:
    """Of cells -REACH to REACH + 1, shape (2 REACH + 2,), for a point at f [cells] in [0, 1) behind the centre of cell
    0.
    """
    if f > 0.5:
        return shares(1.0 - f)[::-1]
    before, beyond = (1.0 - f) * (1.0 - 2.0 * f) / 4.0, -f * (1.0 - 2.0 * f) / 4.0
    second = f + before - 2.0 * beyond
    four = np.array([0.0, before, 1.0 - before - second - beyond, second, beyond, 0.0])
    w = np.convolve(four, [SMOOTHED, 1.0 - 2.0 * SMOOTHED, SMOOTHED], "same")
    return w - w[-1] * np.array([0.0, 0.0, -1.0, 3.0, -3.0, 1.0])


def spread(values: np.ndarray, f: np.ndarray) -> np.ndarray:
    """An array of cells, each spread from a point f (dim,) behind its centre: larger by 2 REACH + 1 along each axis, by
    REACH before it.
    """
    for axis, place in enumerate(f):
        along = np.moveaxis(values, axis, 0)
        wider = np.zeros((len(along) + 2 * REACH + 1, *along.shape[1:]))
        for n, share in enumerate(shares(float(place))):
            wider[n : n + len(along)] += share * along
        values = np.moveaxis(wider, 0, axis)
    return values


def tilted(weights: np.ndarray, points: np.ndarray, centroid: np.ndarray) -> np.ndarray:
    """Weights (n,) of points (n, dim) that differ least, in relative entropy, from those given and have that centroid.

    Where the points do not surround it, they come near it. All lengths are in cells. The dual problem is convex, of dim
    unknowns, here by Newton's method: scipy.optimize takes half a second to import.
    """
    away = points - centroid
    near = 1e-3  # of the centroid, over the tilt: keeps it finite
    tilt = np.zeros(points.shape[1])

    def dual(tilt: np.ndarray) -> tuple[float, np.ndarray]:
        exponent = away @ tilt
        w = weights * np.exp(exponent - exponent.max())
        return exponent.max() + np.log(w.sum()) + 0.5 * near * float(tilt @ tilt), w / w.sum()

    value, w = dual(tilt)
    for _ in range(100):
        mean = w @ away
        slope = mean + near * tilt
        curvature = (w[:, None] * away).T @ away - np.outer(mean, mean) + near * np.eye(len(tilt))
        step = -np.linalg.solve(curvature, slope)
        if -(slope @ step) < 1e-14:
            break
        length = 1.0
        while (new := dual(tilt + length * step))[0] > value + 1e-4 * length * float(slope @ step):
            length *= 0.5
            if length < 1e-6:
                return w
        tilt, (value, w) = tilt + length * step, new
    return w
