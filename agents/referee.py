"""Referee: decides whether robots find a source, by coming within reach or by declaring the source's position.

Only the referee knows the sources.
"""

import numpy as np

from taichi_plume.agents.columns import Columns
from taichi_plume.agents.serial_loops import runs_serially
from taichi_plume.engine import ti
from taichi_plume.grid.kernels import Template


class Referee(Columns):
    """Mixin of the swarm that judges searches: it knows the sources, which the robots do not."""

    @ti.func
    def searches(self, i):
        """Return whether robot i still searches: no source found and, if declaring ends searches, none declared."""
        return self.found[i] == 0 and (self.by_declaring[i] == 0.0 or self.declarations[i] == 0)

    @ti.func
    def _reaches(self, i):
        """Return whether a source is within reach of robot i, for drones in all three directions."""
        return self._is_source(i, self.position[i], self.flies)

    @ti.func
    def _is_source(self, i, place, in_space: Template):
        """Return whether a source is within robot i's reach of `place` (2,) [m]; in_space: also in height."""
        near = 0
        for s in range(self.source_count):
            apart = place - self.source(i, s)
            distance = ti.select(
                self.square[i] > 0.0, ti.max(ti.abs(apart[0]), ti.abs(apart[1])), apart.norm()
            )
            if ti.static(in_space):
                above = self.middle_over(i, s)
                distance = ti.select(
                    self.square[i] > 0.0,
                    ti.max(distance, ti.abs(above)),
                    ti.sqrt(distance * distance + above * above),
                )
            if distance <= self.reach[i]:
                near = 1
        return near == 1

    @ti.func
    def source(self, i, s):
        """Return the position (2,) [m] of source s in the trial of robot i."""
        place = self.sources[s]
        if ti.static(self.apart):
            there = self.episodes.sources[self.episodes.of(i), s]
            place = ti.Vector([there[0], there[1]])
        return place

    @ti.func
    def declare(self, i, place, t):
        """Judge robot i's declaration at time t [s] of a source at `place` (2,) [m], on the floor for drones too.

        With `found: declared` the declaration ends the search, right or wrong. Otherwise the search continues, and the
        first right declaration is stored, or else the last.
        """
        if self.searches(i):
            right = self._is_source(i, place, False)
            was_right = self.declarations[i] > self.false_declarations[i]
            self.declarations[i] = self.declarations[i] + 1
            if not right:
                self.false_declarations[i] = self.false_declarations[i] + 1
            if not was_right:
                self.declared_position[i], self.declared_time[i] = place, t
            if right and self.by_declaring[i] == 1.0:
                self.found[i] = 1
                self.found_time[i] = t

    def declare_all(self, start: int, places: np.ndarray, t: float) -> None:
        """Judge declarations at time t [s] of the robots from index `start` on: (robots, 2) [m], NaN for none."""
        if np.isfinite(places).any():
            self._declare_all(start, places.astype(np.float32), t)

    @ti.kernel
    def _declare_all(self, start: int, places: ti.types.ndarray(dtype=ti.f32, ndim=2), t: float):
        ti.loop_config(serialize=ti.static(runs_serially(self.count)))
        for n in range(places.shape[0]):
            if not ti.math.isnan(places[n, 0]):
                self.declare(start + n, ti.Vector([places[n, 0], places[n, 1]]), t)
