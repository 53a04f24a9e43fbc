"""Truth behind the observations, for critics of actor-critic methods that see more than the actor (asymmetric critics).

Nothing is computed or compiled unless an environment is made with `truth=True` or a reward function asks for the truth.
"""

from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.agents.observation import DECADES
from taichi_plume.agents.trials import FAR

if TYPE_CHECKING:
    from taichi_plume.envs.episodes import Array, Episodes

KEYS = ("true_ppm", "robot_position", "robot_heading", "source_position", "source_offset")


class Truth:
    """Reader of the true state of the robots of `Episodes`; n robots in all, those of environment e in a row.

    Positions and offsets of drones have a third number, upward; their position is that of the middle of the body.

    true_ppm (n,): gas at the robot's first gas sensor [ppm], without lag and noise. robot_position (n, 2) [m];
    robot_heading (n,) [rad], counterclockwise from x. source_position (n, 2): position of the nearest source [m].
    source_offset (n, 2): distance to the nearest source ahead of the robot and to its left [m]; left and right are
    swapped in a mirrored world, as in the observation. The other keys are those of the unmirrored room, as in pictures.
    Positions of sources are NaN if there is no source.
    """

    def __init__(self, of: "Episodes"):
        swarm = of.swarm
        assert swarm.episodes is not None
        self._fields = (
            swarm.position,
            swarm.heading,
            of.sensors.noses[0].true_ppm,
            swarm.episodes.sources,
            of.kernel.mirror,
        )
        self._robots, self._swarm = of.robots, swarm

    def read(self) -> "dict[str, Array]":
        """Return the present truth by key, as NumPy arrays of float32."""
        positions, headings, ppm, sources, mirrored = (field.to_numpy() for field in self._fields)
        if self._swarm.flies:
            middle = self._swarm.altitude.to_numpy() + 0.5 * self._swarm.height.to_numpy()
            positions = np.column_stack([positions, middle])
        trial = np.arange(len(positions)) // self._robots
        apart = sources[trial] - positions[:, None]  # (n, sources, 2)
        squares = (apart**2).sum(axis=2)
        nearest = np.arange(len(positions)), squares.argmin(axis=1)
        none = squares[nearest] > (0.5 * FAR) ** 2
        way = np.where(none[:, None], np.nan, apart[nearest])
        cos, sin = np.cos(headings), np.sin(headings)
        left = (1 - 2 * mirrored[trial]) * (cos * way[:, 1] - sin * way[:, 0])
        values = (
            ppm,
            positions,
            headings,
            positions + way,
            np.column_stack([cos * way[:, 0] + sin * way[:, 1], left, *way[:, 2:].T]),
        )
        return {key: value.astype(np.float32) for key, value in zip(KEYS, values, strict=True)}

    def state(self) -> np.ndarray:
        """Return the global state of each environment for centralised training, (environments, size).

        Of each robot: position, heading, gas entry and nearest source, 7 numbers, of drones 9. Positions run from -1 to
        1 over the floor and, of drones, up to the ceiling. In a mirrored world y and the sine of the heading are
        mirrored as in observations.
        """
        truth = self.read()
        flip = 1.0 - 2.0 * self._fields[4].to_numpy()[np.arange(len(truth["true_ppm"])) // self._robots]
        bounds = self._swarm.clearance
        low, high = (np.array(end, float) for end in (bounds.low, bounds.high))
        if self._swarm.flies:
            low, high = np.append(low, 0.0), np.append(high, bounds.layers.ceiling)
        places = []
        for key in ("robot_position", "source_position"):
            place = np.nan_to_num(2.0 * (truth[key] - low) / (high - low) - 1.0)
            place[:, 1] *= flip
            places.append(place)
        heading = truth["robot_heading"]
        gas = np.log10(1.0 + np.maximum(self._swarm.reading.to_numpy(), 0.0)) / DECADES
        rows = np.column_stack([places[0], np.cos(heading), flip * np.sin(heading), gas, places[1]])
        return np.clip(rows, -1.0, 1.0).astype(np.float32).reshape(-1, self._robots * rows.shape[1])
