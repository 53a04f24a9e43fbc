"""Surge-spiral: straight upwind while in the plume, then an Archimedean spiral around where the plume was lost.

After Lochmatter & Martinoli, "Theoretical analysis of three bio-inspired plume tracking algorithms", ICRA 2009,
doi:10.1109/ROBOT.2009.5152521. FIND, UPWIND, U and s as in `tracking`.

SURGE   drive along U; out of the plume for lost_distance: SPIRAL
SPIRAL  along r = gap phi / 2 pi, turning towards s; after the set number of turns, or when blocked, FIND
"""

from math import pi

from taichi_plume.agents.decisions import Decision
from taichi_plume.agents.groups import GroupRange
from taichi_plume.agents.parameters import Numbers
from taichi_plume.agents.tracking import FIND, STEER, PlumeTracker
from taichi_plume.engine import ti
from taichi_plume.scenario import algorithms

SURGE, SPIRAL = range(2, 4)


class SurgeSpiral(PlumeTracker):
    """Search algorithm that surges upwind in the plume and spirals after losing it. tick: control period [s]."""

    STREAM = "surge_spiral"
    STATE: tuple[str, ...] = (*PlumeTracker.STATE, "phi", "began")
    STATE_NAMES: tuple[str, ...] = ("FIND", "UPWIND", "SURGE", "SPIRAL")
    DECISIONS: tuple[Decision, ...] = (
        *PlumeTracker.DECISIONS,
        Decision("spiral_angle", "rad", "angle covered on the last spiral", "phi"),
    )

    def _allocate(self) -> None:
        super()._allocate()
        self.phi = ti.field(ti.f32, self.size)  # angle covered on the spiral [rad]
        self.began = ti.field(ti.f32, self.size)  # heading at the middle of the spiral [rad]

    def numbers(self, group: GroupRange, model: algorithms.SurgeSpiral) -> Numbers:
        return {
            **super().numbers(group, model),
            "widening": model.gap / (2.0 * pi),  # dr/dphi [m]
            "most": 2.0 * pi * model.turns,  # phi [rad]
            # way by which steering lags [m]
            "lag": group.speed(model.speed) * max(STEER, group.model.turn_time),
        }

    @ti.func
    def _course(self, n):
        course = self._finding_course(n)
        state = self.swarm.state[self.robot[n]]
        if state == SURGE:
            course = self.upwind[n]
        elif state == SPIRAL:
            # a spiral's tangent is turned by phi + atan(phi) from its first direction
            phi = self.phi[n]
            phi += self.p.lag[n] / (self.p.widening[n] * ti.sqrt(1.0 + phi**2))
            angle = self.began[n] + self.side[n] * (phi + ti.atan2(phi, 1.0))
            course = ti.Vector([ti.cos(angle), ti.sin(angle)])
        return course

    @ti.func
    def _decide(self, n, dt):
        i = self.robot[n]
        state = self.swarm.state[i]
        if state == SURGE:
            if not self._still_smells(n) and (
                self._driven(n) >= self.p.lost_distance[n] or self.bump[n] == 1
            ):
                self.phi[n], self.began[n] = 0.0, self.swarm.believed_heading[i]
                self.side[n] = -self.side[n]
                self._enter(n, SPIRAL)
        elif self._comes_upon_plume(n):
            self._enter(n, SURGE)
        elif state == SPIRAL:
            # ds = widening sqrt(1 + phi²) dphi
            self.phi[n] += self._driven(n) / (self.p.widening[n] * ti.sqrt(1.0 + self.phi[n] ** 2))
            self.mark[n] = self.swarm.odometer[i]
            if self.phi[n] > self.p.most[n] or self.bump[n] == 1:
                self._enter(n, FIND)
        else:
            self._find(n)
