"""Turbulence of the air that openings blow in: filtered noise with a length and a time scale (digital filter)."""

from math import pi

import numpy as np
from scipy.ndimage import gaussian_filter

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
        self.sigma = length / patch.grid.dx / np.sqrt(pi)
        impulse = np.zeros(patch.profile.shape)
        impulse[(0,) * impulse.ndim] = 1.0
        self.norm = np.sqrt((gaussian_filter(impulse, self.sigma, mode="wrap") ** 2).sum())
        self.state = np.array([self._slice() for _ in range(patch.grid.dim)])

    def _slice(self) -> np.ndarray:
        """A plane of unit-variance noise, correlated over the length."""
        noise = self.rng.standard_normal(self.patch.profile.shape)
        return gaussian_filter(noise, self.sigma, mode="wrap") / self.norm

    def advance(self, speed: float, dt: float) -> np.ndarray:
        """The next planes, one per velocity component, of unit variance; the one through the face has no mean."""
        decay = np.exp(-pi * dt * abs(speed) / (2.0 * self.length))
        fresh = np.array([self._slice() for _ in self.state])
        self.state = self.state * decay + fresh * np.sqrt(1.0 - decay**2)
        planes = self.state * self.patch.covered
        axis = self.patch.axis
        planes[axis] -= self.patch.covered * planes[axis].sum() / self.patch.covered.sum()
        return planes
