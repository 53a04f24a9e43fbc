"""Facts about the room that a robot's model of dispersion needs: its height, its openings and the gas."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taichi_plume.scenario.species import Species


@dataclass(frozen=True)
class Room:
    """Facts about a room that robots know, besides the obstacles of their clearance map.

    extent: along each axis [m]; depth: of the layer of air in 2-D [m]. passes_edge: see `Floor` of gas maps.
    species: of the gas that robots search for, None without gas.
    """

    extent: tuple[float, ...]
    depth: float
    passes_edge: Callable[[int, int, np.ndarray, float], np.ndarray]
    species: Species | None

    @property
    def height(self) -> float | None:
        """Height of a 3-D room [m]; None in 2-D."""
        return self.extent[2] if len(self.extent) == 3 else None
