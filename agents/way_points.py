"""Way to a cell of the floor along a shortest path, from corner to corner, for algorithms that choose where to measure.

`shortest_paths` gives the corners and `potential` drives among robots and walls.
"""

import numpy as np

from taichi_plume.agents.members import Members
from taichi_plume.agents.potential import NEAR, Potential
from taichi_plume.agents.shortest_paths import FAR, Ways
from taichi_plume.engine import ti

ON_THE_WAY = 0.5  # cells: distance from a corner of the path that counts as arrival


class WayPoints:
    """Paths of robots to cells of `roads`; call `set_out`, then `follow` in each time step until the arrival."""

    STATE = ("goal", "next")

    def __init__(self, members: Members, roads: Ways, potential: Potential):
        self.roads, self.potential, self.cell = roads, potential, roads.cell
        self.goal = ti.field(ti.i32, members.size)  # cell at the end of the path
        self.next = ti.field(ti.i32, members.size)  # cell of the next corner

    @property
    def places(self) -> np.ndarray:
        """Centre of the cell to which each robot drives, (size, 2) [m]."""
        goal, columns = self.goal.values, self.roads.shape[1]
        return np.array(self.roads.low) + self.cell * (
            np.stack([goal // columns, goal % columns], axis=-1) + 0.5
        )

    @ti.func
    def set_out(self, n, start, goal):
        """Let robot n go from the cell `start` to the cell `goal`, to which there is a path."""
        self.goal[n] = goal
        self.next[n] = ti.cast(self.roads.via[start, goal], ti.i32)
        self.potential.set_out(n)

    @ti.func
    def nearest_to(self, start, place):
        """Return the cell nearest to the point `place` [m] among those with a path from the cell `start`."""
        best, nearest = start, FAR
        for c in range(self.roads.count):
            distance = (self.roads.center(c) - place).norm()
            if self.roads.length[start, c] < FAR and distance < nearest:
                best, nearest = c, distance
        return best

    @ti.func
    def follow(self, n, dt):
        """Drive robot n along its path for dt [s]; stop it and return True at the end of the path, or if blocked."""
        arrived = False
        last = self.next[n] == self.goal[n]
        place = self.roads.center(self.next[n])
        if self.potential.is_over(n, place, ti.select(last, NEAR, ON_THE_WAY * self.cell)):
            if last or self.potential.is_stuck(n):
                arrived = True
            else:
                self.next[n] = ti.cast(self.roads.via[self.next[n], self.goal[n]], ti.i32)
                self.potential.set_out(n)
        if arrived:
            self.potential.stand(n)
        else:
            self.potential.drive(n, self.roads.center(self.next[n]), dt)
        return arrived
