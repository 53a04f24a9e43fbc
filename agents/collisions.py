"""Collision detection and response: free path of a robot to walls, obstacles, robots of its trial and moving obstacles.

Moving obstacles are called walkers. Among drones all bodies are upright cylinders from their `altitude` up by their
`height`. Cylinders collide only with bodies at their height, and with floor, ceiling and obstacles above or below.
"""

from taichi_plume.agents.columns import Columns
from taichi_plume.engine import ti

SKIN = 1e-3  # m, gap around a body: far more than the rounding of its position
TOUCH = 1e-4  # m, shorter free steps count as contact
OPEN = 1.5  # gap over the length of a free path: a bilinear clearance map is no steeper than √2
PROBES = 256  # looks ahead per move; sliding along a wall takes one per 2 mm
GRAZE = 1e-3  # sine of the angle below which a body passes a disc without contact
AROUND = 18  # steps of 5 degrees, to each side, in which a robot seeks room beside a walker
CLEAR, PUSHED, PINNED = range(3)  # results of `escape` for a robot that a walker runs into


class Contact:
    """Collision detection and response for the robots of a swarm.

    The ti.funcs ``distance(p)`` and ``normal(p)`` of the swarm's clearance give a lower bound of the distance [m] from
    p to the next wall or obstacle, and the unit vector away from the obstacle; with drones the clearance has `layers`.
    """

    def __init__(self, swarm: Columns):
        self.clearance, self.position, self.radius = swarm.clearance, swarm.position, swarm.radius
        self.members, self.team_size = swarm.members, swarm.team_size
        self.discs, self.disc_radius, self.walkers = swarm.discs, swarm.disc_radius, swarm.walker_count
        self.flying = swarm.flies
        if swarm.flies:
            self.altitude, self.height, self.wings = swarm.altitude, swarm.height, swarm.wings
            self.spans, self.layers = swarm.spans, swarm.clearance.layers

    @ti.func
    def slide(self, i, k, begin, displacement):
        """Move robot i of trial k from `begin` by `displacement` [m], stopped by contact and slid along surfaces.

        Return the new position (2,), the length of the path [m] and whether the robot touched anything.
        """
        p = begin
        rest = displacement
        path = 0.0
        contact = 0
        for _leg in range(2):  # straight on, then the rest along the first surface
            length = rest.norm()
            if length > 0.0:
                e = rest / length
                step, normal, met = self.trace(i, k, p, e, length)
                p += step * e
                path += step
                rest = (length - step) * e
                rest -= ti.min(rest.dot(normal), 0.0) * normal
                contact = ti.max(contact, met)
                if met == 1 and rest.norm() > TOUCH:
                    # a little off the surface, or rounding would press the body into it
                    rest = (rest + TOUCH * normal).normalized() * rest.norm()
                else:
                    rest *= 0.0
        return p, path, contact

    @ti.func
    def trace(self, i, k, p, e, length):
        """Return robot i's free length [m] from p along e, at most `length`; the contact normal; whether it touches."""
        free, normal, contact = self._free_of_discs(i, k, p, e, length)
        s, wall, met = self._free_of_walls(i, p, e, free)
        if met == 1:
            normal, contact = wall, met
        return s, normal, contact

    @ti.func
    def _free_of_walls(self, i, p, e, free):
        """Find the first collision of robot i with walls and standing obstacles on its path from p along e.

        Return the free length [m], at most `free`; the surface normal at its end; whether the robot touches there.
        """
        normal = ti.Vector([0.0, 0.0])
        contact = 0
        # Sphere tracing with over-relaxation (Keinert et al. 2014, doi:10.2312/stag.20141233): as no distance
        # changes by more than the stride, a stride is free if the gaps at its two ends together cover it.
        r = self.radius[i]
        layer = self._layer(i)
        gap = self._distance(p, layer) - r
        s = 0.0
        if gap > OPEN * free + SKIN:
            s = free  # most moves: the end needs no check
        stride = ti.min(free, 2.0 * gap)
        probes = 0
        while s < free and probes < PROBES:
            probes += 1
            ahead = self._distance(p + (s + stride) * e, layer) - r
            if stride > 0.0 and gap + ahead >= stride and (ahead >= SKIN or ahead >= gap):
                s += stride
                gap = ahead
                stride = ti.min(free - s, 2.0 * gap)
            elif stride > TOUCH:
                stride *= 0.5
            else:
                free = s
                contact = 1
                normal = self._normal(p + s * e, layer)
        return s, normal, contact

    @ti.func
    def _layer(self, i):
        """Return the index of the clearance layer in which drone i flies; -1 for ground robots."""
        layer = -1
        if ti.static(self.flying):
            if self.wings[i] == 1.0:
                layer = self.layers.index(self.altitude[i])
        return layer

    @ti.func
    def _distance(self, p, layer):
        result = 0.0
        if ti.static(self.flying):
            if layer >= 0:
                result = self.layers.distance(p, layer)
            else:
                result = self.clearance.distance(p)
        else:
            result = self.clearance.distance(p)
        return result

    @ti.func
    def _normal(self, p, layer):
        result = ti.Vector([0.0, 0.0])
        if ti.static(self.flying):
            if layer >= 0:
                result = self.layers.normal(p, layer)
            else:
                result = self.clearance.normal(p)
        else:
            result = self.clearance.normal(p)
        return result

    @ti.func
    def _span(self, k, m):
        """Return the lowest and highest point [m] of body m of trial k; bodies are the robots, then the walkers."""
        span = ti.Vector([0.0, 0.0])
        if m < self.team_size[k]:
            j = self.members[k, m]
            span = ti.Vector([self.altitude[j], self.altitude[j] + self.height[j]])
        else:
            span = self.spans[m - self.team_size[k]]
        return span

    @ti.func
    def _is_beside(self, i, k, m):
        """Return whether body m of trial k overlaps robot i in height; always True without drones."""
        result = True
        if ti.static(self.flying):
            span = self._span(k, m)
            low, high = self.altitude[i], self.altitude[i] + self.height[i]
            result = span[0] < high + 0.5 * SKIN and span[1] > low - 0.5 * SKIN
        return result

    @ti.func
    def rise(self, i, k, p, way):
        """Return the free vertical move [m] of drone i at p, at most `way` (negative: down), and whether it touches."""
        z, h = self.altitude[i], self.height[i]
        low, high = 0.0, ti.max(self.layers.ceiling - h, 0.0)  # of its altitude
        team = self.team_size[k]
        for m in range(team + self.walkers):
            j, apart, reach = self._other(i, k, m, p)
            if j != i and apart.norm() < reach - 0.5 * SKIN:
                span = self._span(k, m)
                if span[0] > z + 0.5 * h:
                    high = ti.min(high, span[0] - SKIN - h)
                if span[1] < z + 0.5 * h:
                    low = ti.max(low, span[1] + SKIN)
        layer = self.layers.index(z)
        there = self.layers.index(z + way)
        r = self.radius[i] + 0.5 * SKIN
        while layer < there and self.layers.distance(p, layer + 1) >= r:
            layer += 1
        if layer < there:
            high = ti.min(high, self.layers.levels[layer + 1] - SKIN)
        while layer > there and self.layers.distance(p, layer - 1) >= r:
            layer -= 1
        if layer > there:
            low = ti.max(low, self.layers.levels[layer] + SKIN)
        # a body that is already closer stops the drone, and does not push it
        step = ti.math.clamp(way, ti.min(low - z, 0.0), ti.max(high - z, 0.0))
        return step, ti.cast(ti.abs(way - step) > 0.0, ti.i32)

    @ti.func
    def escape(self, i, k, p):
        """Move robot i of trial k at p out of the moving obstacle that overlaps it most.

        The shortest way out comes first, then ways to both sides, each to the rim of the obstacle. The way must be free
        of walls and its end of other bodies. A drone without such a way may rise or sink. Return the position, the
        change of altitude [m], CLEAR, PUSHED or PINNED, and the gap [m] between robot and obstacle before the move.
        """
        team = self.team_size[k]
        gap, deepest = 1e6, 0
        for m in range(team, team + self.walkers):
            if self._is_beside(i, k, m):
                _, apart, reach = self._other(i, k, m, p)
                if apart.norm() - reach < gap:
                    gap, deepest = apart.norm() - reach, m
        place, rise, result = p, 0.0, CLEAR
        if gap < -0.5 * SKIN:
            result = PINNED
            _, apart, reach = self._other(i, k, deepest, p)
            e = ti.Vector([1.0, 0.0])
            if apart.norm() > 1e-6:
                e = apart.normalized()
            n = 0
            while n <= 2 * AROUND and result == PINNED:
                angle = 0.5 * ti.math.pi / AROUND * ((n + 1) // 2) * (1 - 2 * (n % 2))
                c, s = ti.cos(angle), ti.sin(angle)
                to = p - apart + reach * ti.Vector([c * e[0] - s * e[1], s * e[0] + c * e[1]])
                way = (to - p).norm()
                if self._is_clear(i, k, to):
                    free, _, _ = self._free_of_walls(i, p, (to - p) / way, way)
                    if free > way - TOUCH:
                        place, result = to, PUSHED
                n += 1
            if ti.static(self.flying):
                if result == PINNED and self.wings[i] == 1.0:
                    span, z = self._span(k, deepest), self.altitude[i]
                    for up in ti.static((span[1] + SKIN - z, span[0] - SKIN - self.height[i] - z)):
                        if result == PINNED:
                            step, met = self.rise(i, k, p, up)
                            if met == 0:
                                rise, result = step, PUSHED
        return place, rise, result, gap

    @ti.func
    def _is_clear(self, i, k, p):
        """Return whether robot i at p overlaps neither another robot of its trial nor a moving obstacle."""
        result = True
        for m in range(self.team_size[k] + self.walkers):
            j, apart, reach = self._other(i, k, m, p)
            if j != i and self._is_beside(i, k, m) and apart.norm() < reach - 0.5 * SKIN:
                result = False
        return result

    @ti.func
    def _other(self, i, k, m, p):
        """Return for body m of trial k: its robot index (-1: moving obstacle), the vector from the body to p, and the
        smallest distance [m] allowed between the centres of the body and robot i.
        """
        j = -1
        apart = ti.Vector([0.0, 0.0])
        reach = self.radius[i] + SKIN
        team = self.team_size[k]
        if m < team:
            j = self.members[k, m]
            apart = p - self.position[j]
            reach += self.radius[j]
        else:
            apart = p - self.discs[m - team]
            reach += self.disc_radius[m - team]
        return j, apart, reach

    @ti.func
    def _free_of_discs(self, i, k, p, e, length):
        """Find the first collision of robot i with other robots of its trial and moving obstacles on its path.

        Arguments and results as for `_free_of_walls`.
        """
        free = length
        normal = ti.Vector([0.0, 0.0])
        contact = 0
        team = self.team_size[k]
        for m in range(team + self.walkers):
            j, apart, reach = self._other(i, k, m, p)
            if j != i and self._is_beside(i, k, m):
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
