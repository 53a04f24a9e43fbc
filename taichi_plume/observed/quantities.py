"""Quantities of a simulation that views show: gas, temperature and wind, with unit, range, colours and precision.

A function in QUANTITIES declares what a run can show. Recording, store, report, pictures, films, live views, topics,
bags and exports go through this table: a new quantity is one function in it.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taichi_plume.files.film import BACKGROUND
from taichi_plume.grid import fields
from taichi_plume.observed.planes import Plane
from taichi_plume.observed.scales import Scale
from taichi_plume.scenario.heat import Heat
from taichi_plume.time_loop import TimeLoop

ABOVE = " above the background"  # end of the name of a gas with a background
NARROWEST = 1.0  # K: least width of a range of temperatures
FINEST = 0.5  # least stored concentration, over the lower end of the colours


@dataclass(frozen=True)
class Rounded:
    """Storage as float16 times `factor`, rounded to `digits` binary digits; values below `least` become 0.

    Relative precision is about 2^-(digits + 1), absolute precision `least`.
    """

    digits: int = 10
    factor: float = 1.0
    least: float = 0.0

    @property
    def largest(self) -> float:
        """Largest value that is stored; larger values become the largest."""
        return (2.0 - 2.0**-self.digits) * 2.0**15 * self.factor

    @property
    def attributes(self) -> dict[str, float]:
        """CF attributes of the packing, and its precision in the quantity's unit."""
        packing = {"scale_factor": self.factor} if self.factor != 1.0 else {}
        return packing | {
            "relative_precision": 2.0 ** -(self.digits + 1),
            "absolute_precision": max(self.least, 2.0 ** -(self.digits + 15) * self.factor),
            "largest_value": self.largest,
        }

    def packed(self, values: np.ndarray) -> np.ndarray:
        """Return values as stored, float16."""
        small = np.clip(values, -self.largest, self.largest).astype(np.float32) / np.float32(self.factor)
        if self.least:
            small[np.abs(small) < self.least / self.factor] = 0.0
        if self.digits < 10:  # in float32: float16 would be rounded twice
            bits, drop = small.view(np.uint32), 23 - self.digits
            bits += np.uint32((1 << (drop - 1)) - 1) + ((bits >> drop) & np.uint32(1))
            bits &= np.uint32(0xFFFFFFFF << drop & 0xFFFFFFFF)
        half = small.astype(np.float16)
        half[np.isnan(values)] = np.nan
        return half


@dataclass(frozen=True)
class Stepped:
    """Storage as int16 in equal steps about an offset, both in the quantity's unit."""

    step: float
    offset: float

    @property
    def attributes(self) -> dict[str, float]:
        """CF attributes of the packing, and its precision in the quantity's unit."""
        return {
            "scale_factor": self.step, "add_offset": self.offset, "relative_precision": 0.0,
            "absolute_precision": self.step / 2, "largest_value": self.offset + 32767 * self.step,
        }  # fmt: skip

    def packed(self, values: np.ndarray) -> np.ndarray:
        """Return values as stored, int16; MISSING for NaN."""
        steps = np.rint((values - np.float32(self.offset)) / np.float32(self.step))
        return np.where(np.isnan(steps), MISSING, np.clip(steps, -32767, 32767)).astype(np.int16)


MISSING = -32768
Values = Callable[[TimeLoop], np.ndarray | None]
AtPoints = Callable[[TimeLoop, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Quantity:
    """Scalar or vector that views show. key: start of the names of its pictures, "gas_0"; colormap: of the viewer.

    cells: function of a simulation that returns the values of all cells (*grid.shape), or None if values are known at
    points only. points: function that returns the values at points (..., dim) [m]; None if cells are as fine. A vector
    has an axis of its components first. components: names of a vector's components, one per axis of the room.
    """

    key: str
    name: str
    unit: str
    scale: Scale
    colormap: str
    cells: Values
    points: AtPoints | None
    precision: Rounded | Stepped
    details: int = 1
    """Pixels per cell and axis."""
    has_column: bool = True
    """Whether the maximum over the height is shown."""
    has_volume: bool = False
    """Whether the viewer shows the quantity as a volume."""
    components: tuple[str, ...] = ()
    in_cells: str = ""
    """Name in datasets of all cells, such as ethanol_ppm; empty if the quantity is a sum of others."""
    meaning: str = ""
    """Meaning of the values, if the name does not say all."""
    attributes: Mapping[str, Any] = field(default_factory=dict)
    """Further attributes of its variables."""

    @property
    def label(self) -> str:
        """Name of the species, or the key of a quantity that is not one of the species."""
        return self.attributes.get("species", self.key)

    @property
    def entity(self) -> str:
        """Path in a recording above the quantity's pictures."""
        return self.key.replace("_", "/")

    def on(self, plane: Plane) -> bool:
        """Return whether the quantity is shown on a plane."""
        return self.has_column or not plane.over_height

    @property
    def title(self) -> str:
        """Name of the quantity with its unit in brackets."""
        return f"{self.name} [{self.unit}]"

    @property
    def heading(self) -> str:
        """Name of the quantity with its unit in brackets, and a capital as first letter."""
        return self.title[:1].upper() + self.title[1:]

    def everywhere(self, sim: TimeLoop, centers: Callable[[], np.ndarray]) -> np.ndarray:
        """Return the values of all cells; at the cell centres if values are known at points only."""
        cells = self.cells(sim)
        if cells is None:
            assert self.points is not None
            cells = self.points(sim, centers())
        return cells


def gases(sim: TimeLoop) -> Iterator[Quantity]:
    """Yield the sum of all gases and, if there are several species, each of them [ppm]."""
    count = len(sim.gas.species)
    if count:
        yield _gas("gas", list(range(count)), sim)
    for n in range(count if count > 1 else 0):
        yield _gas(f"gas_{n}", [n], sim)


def temperature(sim: TimeLoop) -> Iterator[Quantity]:
    """Yield the temperature of the air [K], if it is solved for."""
    if sim.wind.heat is not None and sim.scenario.heat is not None:
        yield _temperature(sim, sim.scenario.heat)


QUANTITIES: list[Callable[[TimeLoop], Iterator[Quantity]]] = [gases, temperature]
"""Scalars of a simulation, in the order in which they are shown."""


def quantities(sim: TimeLoop) -> list[Quantity]:
    """Return the scalars that a simulation can show."""
    return [quantity for of in QUANTITIES for quantity in of(sim)]


def wind(sim: TimeLoop) -> Quantity:
    """Return the velocity of the air [m/s] as a vector quantity."""
    dim = sim.grid.dim

    def points(sim: TimeLoop, where: np.ndarray) -> np.ndarray:
        return np.moveaxis(fields.velocity_at(sim.wind, where, sim.t), -1, 0)

    return Quantity(
        "wind", "velocity of the air", "m s-1", Scale(0.0, 1.0, "linear"), "", lambda _: None, points, Rounded(8),
        components=tuple("uvw"[:dim]), in_cells="wind",
    )  # fmt: skip


def _gas(key: str, which: list[int], sim: TimeLoop) -> Quantity:
    """Return the summed concentration [ppm] of species above their background; which: indices of the species."""
    species = [sim.gas.species[n] for n in which]
    parts = [gas for gas in sim.gas.gases if gas.species in species]
    low, high = sim.scenario.recording.range_ppm

    def cells(sim: TimeLoop) -> np.ndarray | None:
        total = None
        for gas in parts:
            density = gas.cells(sim.t)
            if density is None:
                return None
            ppm = density * np.float32(gas.species.ppm_per_density)
            total = ppm if total is None else total + ppm
        return total

    def points(sim: TimeLoop, where: np.ndarray) -> np.ndarray:
        return fields.excess_at(sim.gas, where, sim.t)[..., which].sum(axis=-1)

    background = float(sum(sim.gas.background[n] for n in which))
    vapour = species[0].name if len(which) == 1 else ""
    meaning = f"mole fraction of {vapour} at 25 degrees and 1 atm" if vapour else ""
    meaning += f", above the background of {background:g} ppm" if vapour and background else ""
    return Quantity(
        key, " + ".join(each.name for each in species) + ABOVE * bool(background), "ppm", Scale(low, high, "log"),
        "inferno", cells, points if any(gas.finer_than_cells for gas in parts) else None,
        Rounded(7, 16.0, FINEST * low), max(gas.details for gas in parts), has_volume=key == "gas",
        in_cells=f"{vapour}_ppm" if vapour else "", meaning=meaning,
        attributes=({BACKGROUND: background} if background else {}) | ({"species": vapour} if vapour else {}),
    )  # fmt: skip


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
    return Quantity(
        "temperature", "temperature", "K", Scale(*given, "linear"), "turbo", cells, None,
        Stepped(0.01, float(reference)), has_column=False, in_cells="temperature", meaning="temperature of the air",
        attributes={"standard_name": "air_temperature"},
    )  # fmt: skip
