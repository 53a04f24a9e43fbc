"""What people want to see beside the robots, once a second: the floor and the gas over it.

tf_static        tf2_msgs/TFMessage         where the sensors are on the robots of the first trial
map              nav_msgs/OccupancyGrid     where no robot can be
plume/SPECIES    sensor_msgs/PointCloud2    ppm at the height of the gas sensors, of points with LEAST or more
"""

from functools import partial
from math import ceil
from typing import Any

import numpy as np

from taichi_plume.files import ros_messages as ros
from taichi_plume.files.ros_robots import MAP, TRANSFORMS, carried
from taichi_plume.grid.fields import ppm_at
from taichi_plume.serve.topics import Message
from taichi_plume.simulation import Simulation

LEAST = 0.1  # ppm
MOST = 20_000  # points that are looked at


class View:
    """Of a simulation."""

    def __init__(self, sim: Simulation):
        self.sim = sim
        length, width, *_ = sim.grid.extent
        step = sim.grid.dx
        step *= max(1.0, ceil(np.sqrt(length * width / step**2 / MOST)))
        x, y = ((np.arange(max(1, round(size / step))) + 0.5) * step for size in (length, width))
        self.places = np.stack(np.meshgrid(x, y, indexing="xy"), axis=-1).reshape(-1, 2)
        heights = [group.model.sensors.nose.height for group in sim.swarm.groups]
        self.height = min(heights, default=0.0) if sim.grid.dim == 3 else 0.0
        above = np.full((len(self.places), 1), self.height)
        self.points = np.hstack([self.places, above]) if sim.grid.dim == 3 else self.places
        self.floor = self._floor()

    def _floor(self) -> np.ndarray:
        """Cells of the grid and a frame of one around, in percent taken: (ny, nx)."""
        grid = self.sim.grid
        nx, ny = (n + 2 for n in grid.shape[:2])
        x, y = ((np.arange(n) - 0.5) * grid.dx for n in (nx, ny))
        places = np.stack(np.meshgrid(x, y, indexing="xy"), axis=-1)
        away = self.sim.swarm.clearance.distance_at(places.reshape(-1, 2)).reshape(ny, nx)
        return np.where(away > 0, 0, 100)

    def messages(self) -> list[Message]:
        """What there is to see now."""
        t, dx = self.sim.t, self.sim.grid.dx
        floor = partial(ros.grid, self.floor, dx, -dx, t, MAP)
        return [
            Message("tf_static", TRANSFORMS, self._sensors),
            Message("map", ros.GRID, floor),
            *(
                Message(f"plume/{ros.word(species.name)}", ros.POINTS, partial(self._gas, n, t))
                for n, species in enumerate(self.sim.gas.species)
            ),
        ]

    def _sensors(self) -> Any:
        """Where they are on the robots."""
        flat, groups = self.sim.grid.dim == 2, self.sim.swarm.groups
        robots = [(f"{ros.word(one.name)}_{n}", one.model) for one in groups for n in range(one.count)]
        places = [each for name, model in robots for each in carried(name, model.sensors, flat)]
        return ros.message(TRANSFORMS, transforms=places)

    def _gas(self, n: int, t: float) -> Any:
        """A species as points."""
        ppm = ppm_at(self.sim.gas, self.points, t)[:, n]
        there = ppm >= LEAST
        x, y = self.places[there].T
        columns = {"x": x, "y": y, "z": np.full(len(x), self.height), "ppm": ppm[there]}
        return ros.cloud(columns, t, MAP)
