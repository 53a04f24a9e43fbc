"""Turbulence of the air that openings blow in: filtered noise with a length and a time scale (digital filter)."""

from math import pi

import numpy as np
from scipy.ndimage import gaussian_filter1d

from taichi_plume.grid.rng import generator
from taichi_plume.solvers.patches import JetPatch


class Fluctuations:
    """Turbulent velocity of a jet, as planes of unit variance over the cells of its face.

    Gaussian correlation in space (Klein et al. 2003, doi:10.1016/S0021-9991(03)00090-1) over `length` [m], exponential
    in time (Xie & Castro 2008, doi:10.1007/s10494-008-9151-5); no net flux.
    """

    STATE = ("rng", "state")

    def __init__(self, patch: JetPatch, length: float, seed: int, name: str):
        self.patch = patch
        self.length = length
        self.rng = generator(seed, name)
        sigma = length / patch.grid.dx / np.sqrt(pi)
        # the filter along each axis of the face, of unit variance: rows of a matrix
        self.filters = [gaussian_filter1d(np.eye(n), sigma, axis=0, mode="wrap") for n in patch.profile.shape]
        for matrix in self.filters:
            matrix /= np.linalg.norm(matrix, axis=1, keepdims=True)
        self.state = self._slices()

    def _slices(self) -> np.ndarray:
        """Planes of unit-variance noise, one per velocity component, correlated over the length."""
        planes = self.rng.standard_normal((self.patch.grid.dim, *self.patch.profile.shape))
        for axis, matrix in enumerate(self.filters):
            planes = np.moveaxis(np.tensordot(matrix, planes, axes=(1, axis + 1)), 0, axis + 1)
        return planes

    def advance(self, speed: float, dt: float) -> np.ndarray:
        """The next planes, one per velocity component, of unit variance; the one through the face has no mean."""
        decay = np.exp(-pi * dt * abs(speed) / (2.0 * self.length))
        self.state = self.state * decay + self._slices() * np.sqrt(1.0 - decay**2)
        planes = self.state * self.patch.covered
        axis = self.patch.axis
        planes[axis] -= self.patch.covered * planes[axis].sum() / self.patch.covered.sum()
        return planes
