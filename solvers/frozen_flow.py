"""Frozen flow: time average of a computed flow; the average is divergence-free like the flow."""

from collections.abc import Callable, Sequence

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Faces
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.winds import FrozenWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.momentum import BuoyantScalar
from taichi_plume.solvers.screens import Resistance


class FrozenSolver(FlowSolver):
    """Flow solver that freezes: at time `after`, u and nu become their means over the last `average` seconds.

    From then on the flow needs no computation and schedules have no effect. The fluctuations are gone, and with them
    the meandering and the intermittency of a plume: nu does not replace their mean mixing.
    """

    STATE = (*FlowSolver.STATE, "means", "frozen", "_averaged")

    def __init__(
        self,
        model: FrozenWind,
        grid: Grid,
        air: Air,
        t: float = 0.0,
        seed: int = 0,
        weighing: Sequence[BuoyantScalar] = (),
        resistances: Sequence[Callable[[Faces], Resistance]] = (),
    ):
        super().__init__(model, grid, air, t, seed, weighing, resistances)
        self.until = t + model.after
        self.since = self.until - (0.5 * model.after if model.average is None else model.average)
        self.frozen = False
        self._averaged = 0.0  # time averaged so far [s]

    def _list_passes(self) -> None:
        super()._list_passes()
        moving = [*self.u, *([self.nu] if self.nu is not None else [])]
        self.means = tuple(self.grid.field() for _ in moving)
        self._average = self.grid.blending(self.means, moving)
        self._stand_still = self.grid.blending(moving, self.means)

    def stable_dt(self, t: float = 0.0) -> float:
        """Return the largest stable time step [s] of the flow at time t; infinite once the flow is frozen."""
        return float("inf") if self.frozen else super().stable_dt(t)

    def advance(self, t: float, dt: float) -> None:
        if self.frozen:
            return
        super().advance(t, dt)
        end = t + dt + 1e-9 * dt
        # the whole step is in the span, or this is the last step
        if end > self.since + dt or end >= self.until:
            self._averaged += dt
            self._average(dt / self._averaged)
        if end >= self.until:
            self._stand_still(1.0)  # ghosts too: beyond the inlets the mean counts, not the last gust
            self._measure()
            self.frozen = True
