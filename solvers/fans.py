"""Fans with a characteristic curve (fan curve): the pressure behind the opening sets the flow rate.

dp = dp0 (1 - (Q/Q0)²), Q the flow rate and dp the mean pressure behind the opening over that of the still air outside.
The excess of the fan's pressure accelerates the air in front, of inertia m (kinematic pressure over the acceleration
that causes it [m]), and the fan's blades,

    (m + r) dU/dt = dp0/rho (1 - (U/U0)²) - p,   r = 2 dp0/(rho U0) response,

p the kinematic pressure without the part that accelerates the air. Implicit in U, for a p that grows with U².
"""

import numpy as np

from taichi_plume.engine import ti
from taichi_plume.grid.kernels import Template
from taichi_plume.scenario.openings import FanCurve

LEAST = 0.05  # fraction of the free speed below which the resistance is linear


@ti.kernel
def _mean(p: Template, cells: Template, weights: Template, count: Template) -> ti.f32:
    total = 0.0
    for _ in range(1):  # in a fixed order, so that equal runs give equal results
        for n in range(count):
            total += weights[n] * p[cells[n]]
    return total


class CurvedFan:
    """Speed of a fan with a characteristic curve. area: of the opening [m²]; density: of the air [kg/m³].

    cells: (n, dim) behind the opening, on the padded grid; weights: weights of their pressures. speed: at the start
    [m/s]. The caller sets the inertia of the air in front.
    """

    STATE = ("speed", "acceleration")

    def __init__(
        self,
        curve: FanCurve,
        speed: float,
        area: float,
        density: float,
        cells: np.ndarray,
        weights: np.ndarray,
    ):
        self.count = len(cells)
        self.cells = ti.filled_vectors(cells)
        self.weights = ti.filled(weights / weights.sum())
        self.speed = speed
        self.free_speed = curve.flow / area
        self.shut_off = curve.pressure / density  # kinematic [m²/s²]
        self.inertia = 0.0  # m of the air in front [m]
        self.blades = 2.0 * self.shut_off / self.free_speed * curve.response  # r [m]
        self.acceleration = 0.0  # acceleration in the last step [m/s²]

    def mean(self, p) -> float:
        """Return the weighted mean of a cell field p behind the opening."""
        return float(_mean(p, self.cells, self.weights, self.count))

    def advance(self, p, dt: float) -> None:
        """Advance the fan's speed by dt [s] at the kinematic pressure p; the speed is never negative."""
        against = self.mean(p) - self.inertia * self.acceleration
        beyond = self.shut_off * (1.0 - (self.speed / self.free_speed) ** 2) - against
        speed = max(self.speed, LEAST * self.free_speed)
        stiffness = 2.0 * (self.shut_off * speed / self.free_speed**2 + max(against, 0.0) / speed)
        change = beyond / ((self.inertia + self.blades) / dt + stiffness)
        before, self.speed = self.speed, max(0.0, self.speed + change)
        self.acceleration = (self.speed - before) / dt
