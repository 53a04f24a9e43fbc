"""Who judges whether robots find a source: by coming within reach of it, or by saying where it is."""

from typing import Any

import taichi as ti

from taichi_plume.agents.columns import Columns
from taichi_plume.grid.kernels import Template


class Referee(Columns):
    """What a swarm knows of the sources, which its robots do not."""

    episodes: Any
    apart: bool
    sources: Any
    source_count: int
    reach: Any
    square: Any
    by_declaring: Any
    flies: bool
    middle_over: Any

    @ti.func
    def searches(self, i):
        """Whether the search of robot i goes on: it found no source and, where that is by declaring, declared none."""
        return self.found[i] == 0 and (self.by_declaring[i] == 0.0 or self.declarations[i] == 0)

    @ti.func
    def _reaches(self, i):
        """Whether a source is within the reach of robot i where it is, of one that flies in all three directions."""
        return self._is_source(i, self.position[i], self.flies)

    @ti.func
    def _is_source(self, i, place, in_space: Template):
        """Whether a source is within the reach of robot i of a place on the floor [m]; in_space: of its middle."""
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
        """Place [m] of the source number s of the trial of robot i."""
        place = self.sources[s]
        if ti.static(self.apart):
            place = self.episodes.sources[self.episodes.of(i), s]
        return place

    @ti.func
    def declare(self, i, place, t):
        """Robot i says at time t [s] that a source is at `place` [m], as it believes; the referee alone judges it.

        Of what flies, too, the place is one on the floor. With `found: declared` its search ends with that, found or
        not. Else it goes on: of what it says the first right place is kept, or the last one.
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
