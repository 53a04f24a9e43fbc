"""Runge-Kutta method of the flow: order and stability of waves that the wind carries, by von Neumann's analysis."""

import numpy as np
import pytest

from taichi_plume.solvers.time_stepping import stages_for

COURANT = (0.2, 1.0, 1.1, 1.15, 1.2, 1.25, 1.3, 1.35, 1.4)
"""Courant numbers (sum of |u| dt/dx over the axes)."""


def advanced(courant: float, growth: np.ndarray) -> np.ndarray:
    """Return exp(growth) as a step of the method approximates it for du/dt = growth u/dt, u = 1 at the start."""
    u = np.ones_like(growth)
    for k, _, _ in stages_for(courant):
        u = 1.0 + k * (u - 1.0 + growth * u)
    return u


def upwind5(phase: np.ndarray) -> np.ndarray:
    """Return du/dt of waves exp(i phase n) over n cells, of unit speed over unit cells, by upwind differences.

    The six-point difference of a fifth-order interpolation to the cells' faces.
    """
    weights = {-3: -2, -2: 15, -1: -60, 0: 20, 1: 30, 2: -3}
    return -np.sum([w * np.exp(1j * n * phase) for n, w in weights.items()], axis=0) / 60.0


@pytest.mark.parametrize("courant", COURANT)
def test_no_wave_grows_in_two_dimensions(courant: float):
    phase = np.linspace(-np.pi, np.pi, 181)
    share = np.linspace(0.0, 1.0, 21)[:, None, None]
    of_both = share * upwind5(phase)[:, None] + (1.0 - share) * upwind5(phase)
    for above in (0.5, 1.0, 1.02):
        assert np.abs(advanced(courant, above * courant * of_both)).max() < 1.0 + 1e-9


@pytest.mark.parametrize("courant", COURANT)
def test_second_order_and_little_damping(courant: float):
    phase = np.array([0.02, 0.04])
    wave = advanced(courant, 1j * phase)
    error = np.abs(wave - np.exp(1j * phase))
    assert np.log2(error[1] / error[0]) > 2.9  # of one step
    lost = (1.0 - np.abs(wave) ** 2) / phase**4
    assert (lost > -1e-4).all()
    if courant <= 1.2:  # up to the default: a seventh of the 1/12 of SSP-RK3
        assert (lost < 1.0 / 84.0).all()
