"""Sensor lag: first-order lag (low-pass) with a time constant."""

from math import expm1


class Lag:
    """First-order lag with a time constant [s], solved exactly over time steps dt [s] with a constant target.

    share: fraction of the distance to the target covered in a step; rest: mean over the step of the remaining distance,
    as a fraction of the distance at the start of the step.
    """

    def __init__(self, time_constant: float, dt: float):
        self.share = -expm1(-dt / time_constant) if time_constant > 0 else 1.0
        self.rest = self.share * time_constant / dt
