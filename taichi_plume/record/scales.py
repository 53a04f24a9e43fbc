"""Scalars drawn in a recording (gas concentration and temperature) with their colour scales."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taichi_plume.grid import fields
from taichi_plume.record.drawing import Scale
from taichi_plume.record.planes import Plane
from taichi_plume.scenario.heat import Heat
from taichi_plume.time_loop import TimeLoop

ABOVE = " above the background"  # end of the name of a gas with a background
NARROWEST = 1.0  # K: least width of a range of temperatures


@dataclass(frozen=True)
class Quantity:
    """Scalar that a recording draws. entity: path above its pictures; colormap: name of the viewer's colormap.

    cells: function of a simulation that returns the values of all cells (*grid.shape), or None if values are known at
    points only. points: function that returns the values at points (..., dim) [m]; None if cells are as fine.
    """

    entity: str
    name: str
    unit: str
    scale: Scale
    colormap: str
    cells: Callable[[TimeLoop], np.ndarray | None]
    points: Callable[[TimeLoop, np.ndarray], np.ndarray] | None
    details: int = 1
    """Pixels per cell and axis."""

    def on(self, plane: Plane) -> bool:
        """Return whether the scalar is drawn on a plane: gas on all, temperature not as maximum over the height."""
        return self.unit == "ppm" or not plane.over_height

    @property
    def title(self) -> str:
        """Name of the scalar with its unit in brackets."""
        return f"{self.name} [{self.unit}]"

    @property
    def heading(self) -> str:
        """Name of the scalar with its unit in brackets, and a capital as first letter."""
        return self.title[:1].upper() + self.title[1:]


def quantities(sim: TimeLoop) -> list[Quantity]:
    """Return the scalars to draw: total gas, each species if there are several, and temperature if it is solved for."""
    found = []
    if sim.gas.species:
        scale = Scale(*sim.scenario.recording.range_ppm, "log")
        several = list(range(len(sim.gas.species)))
        found.append(_gas("gas", several, scale, sim))
        if len(several) > 1:
            found += [_gas(f"gas/{n}", [n], scale, sim) for n in several]
    if sim.wind.heat is not None and sim.scenario.heat is not None:
        found.append(_temperature(sim, sim.scenario.heat))
    return found


def _gas(entity: str, which: list[int], scale: Scale, sim: TimeLoop) -> Quantity:
    """Return the summed concentration [ppm] of species above their background as a scalar to draw; which: indices of
    the species.
    """
    species = [sim.gas.species[n] for n in which]
    gases = [gas for gas in sim.gas.gases if gas.species in species]

    def cells(sim: TimeLoop) -> np.ndarray | None:
        total = None
        for gas in gases:
            density = gas.cells(sim.t)
            if density is None:
                return None
            ppm = density * np.float32(gas.species.ppm_per_density)
            total = ppm if total is None else total + ppm
        return total

    def points(sim: TimeLoop, where: np.ndarray) -> np.ndarray:
        return fields.excess_at(sim.gas, where, sim.t)[..., which].sum(axis=-1)

    name = " + ".join(vapour.name for vapour in species)
    if any(sim.gas.background[n] for n in which):
        name += ABOVE
    finer = any(gas.finer_than_cells for gas in gases)
    details = max(gas.details for gas in gases)
    return Quantity(entity, name, "ppm", scale, "inferno", cells, points if finer else None, details)


def _temperature(sim: TimeLoop, heat: Heat) -> Quantity:
    theta, reference = sim.wind.heat.theta, sim.wind.heat.reference

    def cells(sim: TimeLoop) -> np.ndarray:
        return sim.grid.read(theta) + np.float32(reference)

    given = sim.scenario.recording.range_kelvin
    if given is None:
        air = cells(sim)[~sim.air.solid]
        incoming = [vars(opening).get("temperature") for opening in sim.scenario.openings]
        known = [*heat.likely, *(t for t in incoming if t is not None), float(air.min()), float(air.max())]
        middle, half = (min(known) + max(known)) / 2, max(max(known) - min(known), NARROWEST) / 2
        given = (middle - half, middle + half)
    return Quantity("temperature", "temperature", "K", Scale(*given, "linear"), "turbo", cells, None)
