"""How far a robot gets before it touches a wall, an obstacle, another robot of its trial or what walks about."""

from typing import Any

import taichi as ti

SKIN = 1e-3  # m, air kept around a body: far more than the rounding of its position
TOUCH = 1e-4  # m, steps shorter than this are contact
OPEN = 1.5  # gap over a way that is free all along: a bilinear clearance map is no steeper than √2
PROBES = 256  # looks ahead per move; sliding along a wall takes one per 2 mm
GRAZE = 1e-3  # sine of the angle below which a disc is passed, not met


@ti.data_oriented
class Contact:
    """What is in the way of the robots of a swarm.

    clearance: its ti.funcs ``distance(p)`` and ``normal(p)`` give a lower bound of the distance [m] from p to the next
    wall or obstacle, and the unit vector away from it. position [m], radius [m]: of the robots. members, team_size: the
    robots of each trial, see `Swarm`. discs, disc_radius [m]: of the `walkers` that walk about, at least one place.
    """

    def __init__(
        self,
        clearance: Any,
        position: Any,
        radius: Any,
        members: Any,
        team_size: Any,
        discs: Any,
        disc_radius: Any,
        walkers: int,
    ):
        self.clearance, self.position, self.radius = clearance, position, radius
        self.members, self.team_size = members, team_size
        self.discs, self.disc_radius, self.walkers = discs, disc_radius, walkers

    @ti.func
    def trace(self, i, k, p, e, length):
        """How far [m] robot i gets from p along e, up to `length`; the normal there; whether it touches."""
        free, normal, contact = self._free_of_discs(i, k, p, e, length)
        # Sphere tracing with over-relaxation (Keinert et al. 2014, doi:10.2312/stag.20141233): as no distance
        # changes by more than the way walked, a stride is free if the gaps at its two ends together cover it.
        r = self.radius[i]
        gap = self.clearance.distance(p) - r
        s = 0.0
        if gap > OPEN * free + SKIN:
            s = free  # what most moves are: no need to look where it ends
        stride = ti.min(free, 2.0 * gap)
        probes = 0
        while s < free and probes < PROBES:
            probes += 1
            ahead = self.clearance.distance(p + (s + stride) * e) - r
            if stride > 0.0 and gap + ahead >= stride and (ahead >= SKIN or ahead >= gap):
                s += stride
                gap = ahead
                stride = ti.min(free - s, 2.0 * gap)
            elif stride > TOUCH:
                stride *= 0.5
            else:
                free = s
                contact = 1
                normal = self.clearance.normal(p + s * e)
        return s, normal, contact

    @ti.func
    def _free_of_discs(self, i, k, p, e, length):
        """The same, but for the other robots and for what walks about alone."""
        free = length
        normal = ti.Vector([0.0, 0.0])
        contact = 0
        team = self.team_size[k]
        for m in range(team + self.walkers):
            j = -1
            apart = ti.Vector([0.0, 0.0])
            reach = self.radius[i] + SKIN
            if m < team:
                j = self.members[k, m]
                apart = p - self.position[j]
                reach += self.radius[j]
            else:
                apart = p - self.discs[m - team]
                reach += self.disc_radius[m - team]
            if j != i:
                d = apart.norm()
                along = e.dot(apart)  # negative on approach; the closest point is -along ahead
                if along < -GRAZE * d or (along < 0.0 and d < reach - 0.5 * SKIN):
                    half_chord2 = along * along - (d - reach) * (d + reach)
                    if half_chord2 > 0.0:
                        s = ti.max(-along - ti.sqrt(half_chord2), 0.0)
                        if s < free:
                            free = s
                            contact = 1
                            normal = (apart + s * e).normalized()
        return free, normal, contact
