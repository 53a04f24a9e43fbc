"""Writer of the film `fields.zarr`: recorded wind and gas of a run, for analysis and for playback in later runs."""

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import numpy as np

from taichi_plume.files import disk
from taichi_plume.files.film import GAS, VELOCITIES
from taichi_plume.files.film_writer import NewFilm
from taichi_plume.grid.fields import Carrier, concentration_at
from taichi_plume.observed.quantities import Quantity, quantities
from taichi_plume.scenario.outputs import Fields
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.sources import Source
from taichi_plume.scoring.declarations import Json
from taichi_plume.time_loop import Every, TimeLoop
from taichi_plume.version import __version__


class Filming:
    """Writer of the film (recorded wind, gas and further quantities such as temperature) of a run.

    Raises OSError as soon as the disk is full.
    """

    STATE = ("frames",)

    def __init__(self, sim: TimeLoop, path: Path, model: Fields):
        self.path, self.model = path, model
        self.wind = sim.wind.carrier if "wind" in model.quantities else None
        scenario, grid = sim.scenario, sim.grid
        seeds = " and ".join(f"{name} {seed}" for name, seed in scenario.seeds.items())
        attributes: Json = {
            "title": f"Wind and gas of {scenario.name}",
            "source": f"taichi_plume {__version__}",
            "history": f"taichi_plume {__version__} ran the scenario {scenario.name} with {seeds}",
            "scenario": scenario.name,
            **scenario.seeds,
            "depth": grid.depth,
            "cell_volume": grid.dx**grid.dim * (grid.depth if grid.dim == 2 else 1.0),
            "periodic": list(map(int, grid.periodic)),
        }
        held = np.where(sim.air.solid, 0.0, sim.air.room)
        still: dict[str, np.ndarray] = {
            "volume": sim.air.volume.T.astype(np.float32),
            "air": held.T.astype(np.float32),
        }
        moving = []
        if "wind" in model.quantities and self.wind is None:
            what = f"a wind of kind {scenario.wind.kind} has no face velocities; leave out wind"
            raise ValueError(f"fields.quantities: {what}")
        if self.wind is not None:
            self.speed_names = VELOCITIES[: grid.dim]
            moving += self.speed_names
            moving += ["viscosity"] if self.wind.nu is not None else []
            attributes |= {"viscosity": self.wind.viscosity, "schmidt": self.wind.schmidt}
            for d, name in enumerate(self.speed_names):
                still[f"open_{name}"] = (_faces(grid.read(self.wind.open[d], 1), d, 1).T > 0).astype(np.int8)
                still[f"area_{name}"] = sim.air.area[d].T.astype(np.float32)
        if "gas" in model.quantities:
            moving += [f"{GAS}{species.name}" for species in sim.gas.species]
            attributes["gases"] = _origins(scenario)
        self.further = further(sim) if "temperature" in model.quantities else []
        moving += [quantity.in_cells for quantity in self.further]
        self.frames, self.closing = 0, ExitStack()
        species = sim.gas.species if "gas" in model.quantities else ()
        self._new: Callable[..., NewFilm] = partial(
            NewFilm,
            path,
            grid.shape,
            grid.dx,
            attributes,
            moving,
            still,
            species,
            background=scenario.backgrounds,
            further={
                each.in_cells: {"units": each.unit, "long_name": each.meaning or each.name, **each.attributes}
                for each in self.further
            },
        )

    def start(self) -> None:
        disk.require_room(self.path)
        self._open()

    def resume(self) -> None:
        """Resume the film: cut off the frames after the last `flush`. Raises FilmError if frames are missing."""
        self._open(resume_at=self.frames)

    def _open(self, **options: int) -> None:
        self.film = self._new(**options)
        self.closing.callback(self.film.flush)

    def observer(self) -> Every:
        return Every(1 / self.model.rate, self.shoot, warm_up=True)

    def shoot(self, sim: TimeLoop) -> None:
        """Append a frame with the present wind, gas and further quantities; do nothing before the film's start time."""
        if sim.t < self.model.start - 1e-9 * sim.dt:
            return
        frame = self._wind(sim, self.wind) if self.wind is not None else {}
        if "gas" in self.model.quantities:
            frame |= self._gas(sim)
        for quantity in self.further:
            frame[quantity.in_cells] = quantity.everywhere(sim, sim.grid.centers).T
        disk.require_room(self.path, sum(values.nbytes for values in frame.values()))
        self.film.append(sim.t, frame)

    def flush(self) -> None:
        self.film.flush()
        self.frames = self.film.frames

    def close(self) -> None:
        self.closing.close()

    def _gas(self, sim: TimeLoop) -> dict[str, np.ndarray]:
        """Return the concentration [kg/m³] of each species above its background at the cell centres, by the film's
        variable name.
        """
        names = [f"{GAS}{species.name}" for species in sim.gas.species]
        frame = {name: np.zeros(sim.grid.shape[::-1], np.float32) for name in names}
        for gas in sim.gas.gases:
            c = gas.cells(sim.t)
            if c is None:
                c = concentration_at(gas, sim.grid.centers(), sim.t)
            frame[f"{GAS}{gas.species.name}"] += c.T
        return frame

    def _wind(self, sim: TimeLoop, wind: Carrier) -> dict[str, np.ndarray]:
        grid = sim.grid
        frame = {name: _faces(grid.read(wind.u[d], 1), d).T for d, name in enumerate(self.speed_names)}
        if wind.nu is not None:  # zero before the first step
            frame["viscosity"] = np.maximum(grid.read(wind.nu, 1), np.float32(wind.viscosity)).T
        return frame


def further(sim: TimeLoop) -> list[Quantity]:
    """Return the quantities that a film holds besides wind and gas, such as the temperature of the air."""
    return [each for each in quantities(sim) if each.in_cells and "species" not in each.attributes]


def _origins(scenario: Scenario) -> Json:
    """Return species, sources and background of each gas variable of the film, in the form of a scenario file."""
    origins: Json = {}
    for _, gas in scenario.gases:
        written = gas.model_dump(mode="json", include={"species"})
        background = scenario.backgrounds[gas.vapour.name]
        about = {"species": written["species"], "sources": []} | (
            {"background": background} if background else {}
        )
        known = origins.setdefault(f"{GAS}{gas.vapour.name}", about)
        for source in gas.sources:
            parts = source.model_dump(mode="json", exclude_none=True, include=set(Source.model_fields))
            known["sources"].append(parts if "dish" in parts else {"rate": 0.0} | parts)  # a puff has no rate
    return origins


def _faces(values: np.ndarray, d: int, margin: int = 0) -> np.ndarray:
    """Return values on the cell faces normal to axis d. margin: ghost layers to cut off along the other axes."""
    index = [slice(margin, n - margin) for n in values.shape]
    index[d] = slice(1, None)
    return values[tuple(index)]
