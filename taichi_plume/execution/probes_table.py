"""Writer of `probes.parquet`: wind, gas, pressure and temperature at fixed probes, a row per point and sample."""

from math import ceil
from pathlib import Path

import numpy as np
import pyarrow as pa

from taichi_plume.files.run_tables import NAMES, GrowingTable, column
from taichi_plume.grid.sampler import Sampler
from taichi_plume.scenario.probes import Probes
from taichi_plume.scenario.species import AIR_DENSITY
from taichi_plume.time_loop import EveryStep, TimeLoop

CLOSE = 1e-6  # of a period: as good as on time


class ProbeTable(GrowingTable):
    """Writer of the time series measured by probes at fixed points in the air (`probes.parquet`).

    Points are sampled after every flow step; rows at multiples of a period are linear in time between two steps.
    """

    STATE = (*GrowingTable.STATE, "next", "before", "values_before")

    def __init__(self, sim: TimeLoop, path: Path, model: Probes):
        self.model, self.heat = model, sim.wind.heat
        places = np.concatenate([probe.places for probe in model.points])
        cells = [field for field in (sim.wind.p, self.heat and self.heat.theta) if field is not None]
        self.sampler = Sampler(places, sim.wind, sim.gas, cells, sim.air.solid, sim.grid)
        axes = "xyz"[: sim.grid.dim]
        measured = [(f"wind_{a}", "m/s", f"velocity of the air along {a}", {}) for a in axes]
        for gas in sim.gas.species:
            density = {"kg_per_m3": f"{1 / gas.ppm_per_density:.9g}"}
            if background := sim.scenario.backgrounds[gas.name]:
                density["background_ppm"] = f"{background:.9g}"
            measured.append((f"{gas.name}_ppm", "ppm", f"mole fraction of {gas.name}", density))
        if sim.wind.p is not None:
            measured.append(
                ("pressure", "Pa", "over that outside of an outlet; without an outlet, up to a constant", {})
            )
        if self.heat is not None:
            measured.append(("temperature", "K", "of the air", {}))
        self.measured = [column(name, pa.float32(), *about, **more) for name, *about, more in measured]
        who = [
            column("t", pa.float64(), "s", "simulated time"),
            column("probe", NAMES, "1", "name of the probe"),
            column("point", pa.int32(), "1", "number of the point in its probe"),
            *(column(a, pa.float32(), "m", "position of the point") for a in axes),
        ]
        names = {"probe": pa.array([probe.name for probe in model.points])}
        super().__init__(path, [*who, *self.measured], names, len(places))
        sizes = [probe.size for probe in model.points]
        self.values["probe"][:] = np.repeat(np.arange(len(sizes)), sizes)
        self.values["point"][:] = np.concatenate([np.arange(size) for size in sizes])
        for axis, along in zip(axes, places.T, strict=True):
            self.values[axis][:] = along
        self.next = 0  # multiple of the period that the next rows are for
        self.before = 0.0  # time of the sample before [s]
        self.values_before: np.ndarray | None = None

    def observer(self) -> EveryStep:
        return EveryStep(self.sample)

    def sample(self, sim: TimeLoop, t: float) -> None:
        """Sample the air at time t [s], the end of a flow step, and store the rows that have become due."""
        if t < self.model.start - 1e-9 * sim.dt:
            return
        now = self.sampler.sample(t)
        if self.model.every == "step":
            self._row(t, now)
            return
        period = self.model.every
        if self.values_before is None:
            self.next, self.before, self.values_before = ceil(t / period - CLOSE), t, now
        while self.next * period <= t + CLOSE * period:
            due, span = self.next * period, t - self.before
            share = min(1.0, (due - self.before) / span) if span > 0.0 else 1.0
            self._row(due, now if share > 1 - CLOSE else (1 - share) * self.values_before + share * now)
            self.next += 1
        self.before, self.values_before = t, now

    def _row(self, t: float, sampled: np.ndarray) -> None:
        """Store a row for each point at time t [s]. sampled: values (measured quantities, points)."""
        n = self.pending
        self.values["t"][n] = t
        for field, row in zip(self.measured, sampled, strict=True):
            self.values[field.name][n] = row
        if "pressure" in self.values:
            self.values["pressure"][n] *= AIR_DENSITY
        if self.heat is not None:
            self.values["temperature"][n] += self.heat.reference
        self.took()
