"""Simulation of a scenario step by step, to look at, to change and to record while it runs."""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Self

from pydantic import Field

from taichi_plume.api.simulate import given
from taichi_plume.assembly import own_code
from taichi_plume.assembly.assemble import build
from taichi_plume.assembly.preparation import Source, load
from taichi_plume.engine import program
from taichi_plume.engine.process import one_thread
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.safe_open import as_path
from taichi_plume.observed.observer import Observer
from taichi_plume.observed.planes import cells_of
from taichi_plume.observed.quantities import quantities, wind
from taichi_plume.observed.views import View, output_view, views
from taichi_plume.quantities import Number
from taichi_plume.scenario import si
from taichi_plume.scenario.changes import shown
from taichi_plume.scenario.comparison import differences_at_start
from taichi_plume.scenario.domain import Context
from taichi_plume.scenario.loading import Overrides, ScenarioError, load_part, of_python
from taichi_plume.scenario.outputs import Fields, Output
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.time_loop import Every, TimeLoop

if TYPE_CHECKING:
    import pandas
    import pyarrow
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taichi_plume.execution.outputs import Table

SHORTEST = 1e-9  # of a tick: as good as none
TICKS = Annotated[int, Field(ge=0, strict=True)]


class Simulation:
    """A scenario that is stepped from Python; it writes no files unless asked to, see `write`.

    scenario, seed, overrides, duration, arch, allow_code, allow_outside: as of `simulate`. Simulations of several
    scenarios can be used in turns if they have the same `arch`.

    Raises InputError.

    >>> import taichi_plume as tp
    >>> sim = tp.Simulation("plumesim_casting")
    >>> sim.step()
    >>> sim.t
    0.1
    >>> sim.run(until=2)
    >>> list(sim.gas.data_vars)
    ['ethanol_ppm']
    """

    def __init__(
        self,
        scenario: Source,
        *,
        seed: int | None = None,
        overrides: Overrides | None = None,
        duration: float | str | None = None,
        arch: str = "cpu",
        allow_code: bool = False,
        allow_outside: bool = False,
    ):
        prepared = load(scenario, given(overrides, seed, duration), allow_outside)
        own_code.execute(prepared, allow_code)
        with one_thread():
            program.start(arch)
            self._loop: TimeLoop | None = build(prepared)
        self._advancing = False
        self._looks: list[tuple[float, Callable[[Simulation], object]]] = []
        self._tables: list[Table] = []

    # ---------------------------------------------------------------- time

    @property
    def loop(self) -> TimeLoop:
        """The time loop with its parts: solvers, robots, sensors, maps. Its names may change between versions.

        Raises InputError if the simulation is closed.
        """
        if self._loop is None:
            raise InputError("the simulation is closed; make another, or use reset() instead of close()")
        return self._loop

    @property
    def scenario(self) -> Scenario:
        """The scenario with all its defaults."""
        return self.loop.scenario

    @property
    def t(self) -> float:
        """Simulated time [s]: negative in the warm-up, 0 when the robots start."""
        return round(self.loop.t, 9)

    @property
    def finished(self) -> bool:
        """Whether the end is reached or, with `stop_early`, no robot searches any more."""
        return self.loop.finished

    def step(self, ticks: int = 1) -> None:
        """Advance by a number of time steps (ticks of `scenario.tick`), or to the end.

        Raises InputError, UnstableError, and TurnError while another thread of the process steps, resets or changes a
        simulation.
        """
        ticks = load_part(ticks, "ticks", TICKS)
        with self._turn():
            for _ in range(ticks):
                if self.finished:
                    break
                self.loop.step()
            self._end_if_finished()

    def run(self, until: Number | None = None) -> None:
        """Advance to the time `until`, such as 2 [s] or "2 min", or to the end. Raises the errors of `step`."""
        end: float | None = load_part(until, "until", si.Time | None)
        least = SHORTEST * self.loop.dt
        if end is not None and end < self.loop.t - least:
            raise InputError(
                f"until: got {end:g} s; the time is {self.t:g} s already; use reset to start again"
            )
        with self._turn():
            while not self.finished and (end is None or self.loop.t < end - least):
                self.loop.step()
            self._end_if_finished()

    @contextmanager
    def _turn(self) -> Iterator[None]:
        """Context that steps or resets the simulation. Raises InputError in a function of `every`, and TurnError."""
        with one_thread():
            if self._advancing:
                raise InputError(
                    "every: its functions cannot step, run or reset the simulation that calls them"
                )
            self._advancing = True
            try:
                yield
            finally:
                self._advancing = False

    def _end_if_finished(self) -> None:
        if self.finished:
            self.loop.observe(force=True)
            self._close_tables()

    def reset(self, *, seed: int | None = None, overrides: Mapping[str, object] | None = None) -> None:
        """Return to the start, with another seed or other values of any keys.

        Functions of `every` stay, files of `write` are closed. Raises ScenarioError; the simulation then stays as it
        was.
        """
        changes = of_python(overrides or {}) | ({} if seed is None else {"seed": seed})
        with self._turn():
            self.loop.reset(self.scenario.with_(changes) if changes else None)
            self._close_tables()
            self._forget()
            for period, function in self._looks:
                self._observe(period, function)

    def change(self, changes: Mapping[str, object]) -> None:
        """Give keys other values while the simulation runs, such as ``{"gas.sources.0.rate": "20 mg/s"}``.

        Air, gas and robots stay as they are; the new values hold from now on. Kinds, counts, the shape of the room, and
        keys that act at the start alone cannot be changed: `seed`, `air_seed`, `warm_up`, and each `start`,
        `initial` and `prior` (`values`, `areas`, `rest`, `resolution`, `origin`), and of classifiers `neighbours` and
        `classes`; use `reset` for these. Parameters of an `Own` class can change if it has the methods state() and
        restore(state). Raises TurnError, see `step`, and ScenarioError; the simulation then stays as it was.
        """
        loop, old = self.loop, self.scenario
        scenario = old.with_(changes)
        faults = [
            f"{line}; acts at the start alone; use reset" for line in differences_at_start(old, scenario)
        ]
        if faults:
            raise ScenarioError(faults)
        with one_thread():
            loop.change(scenario)
        self._forget()

    def close(self) -> None:
        """Close the files of `write` and free the memory; the simulation cannot be used any more."""
        self._close_tables()
        self._loop = None
        self._forget()

    def _forget(self) -> None:
        """Remove the observer, which belongs to other components."""
        vars(self).pop("_observer", None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ---------------------------------------------------------------- observers and files

    def every(self, period: Number, function: Callable[["Simulation"], object]) -> None:
        """Call a function with this simulation every `period` simulated seconds, at the start and at the end.

        The function may look at the simulation and `change` it, but not step, run or reset it. Raises InputError.
        """
        interval: float = load_part(period, "every", si.Duration)
        if not callable(function):
            raise InputError(f"every: got {shown(function)}; give a function that takes the simulation")
        self._looks.append((interval, function))
        self._observe(interval, function)

    def _observe(self, period: float, function: Callable[["Simulation"], object]) -> None:
        self.loop.observers.append(Every(period, lambda _: function(self), warm_up=True))

    def write(
        self, path: str | Path, every: Number | None = None, *, view: Mapping[str, object] | None = None
    ) -> None:
        """Write a file from now on, a sample every `every` simulated seconds; `close`, `reset` and the end complete it.

        path: a film of wind, gas and temperature if it ends in .zarr, as `fields.zarr` of a run; a table of the robots
        if it ends in .parquet. view: what a .zarr shows instead, by the keys of the scenario's `outputs`, such as
        ``{"quantity": "gas", "plane": "xz", "at": "1 m"}``; the file is as `pictures.zarr` of a run. every: by default
        0.5 s for films and views, a tick for tables. An existing file is not overwritten. Raises InputError, OSError.
        """
        from taichi_plume.execution.film_output import Filming
        from taichi_plume.execution.robots_table import RobotTable
        from taichi_plume.observed.store import PictureStore

        path, loop = as_path(path, "path"), self.loop
        taken = InputError(f"{path}: exists already, or is being written; choose another name, or remove it")
        if os.path.lexists(path):
            raise taken
        interval: float | None = load_part(every, "every", si.Duration | None)
        if interval is not None and interval < loop.dt * (1 - SHORTEST):
            raise InputError(f"{path}: every: got {interval:g} s; it must be at least a tick, {loop.dt:g} s")
        table: Table
        if view is not None:
            if path.suffix != ".zarr":
                raise InputError(f"{path}: must end in .zarr, as it shows a view")
            output = load_part(
                dict(view) | {"rate": 2.0 if interval is None else 1.0 / interval}, "view", Output
            )
            faults = list(output.errors("view", Context(loop.scenario, {})))
            if faults:
                raise ScenarioError(faults)
            shown = replace(output_view(loop, output, "view"), output="")
            table = PictureStore(Observer(loop, [shown]), path, {"title": f"View of {loop.scenario.name}"})
        elif path.suffix == ".zarr":
            table = Filming(
                loop, path, Fields(rate=2.0 if interval is None else 1.0 / interval, start=loop.t)
            )
        elif path.suffix == ".parquet" and loop.swarm.count:
            table = RobotTable(loop, path)
            table.period = table.period if interval is None else interval
        else:
            what = (
                "the scenario has no robots" if path.suffix == ".parquet" else "must end in .zarr or .parquet"
            )
            raise InputError(f"{path}: {what}")
        observer = table.observer()
        assert isinstance(observer, Every)
        try:
            table.start()
        except FileExistsError:
            raise taken from None
        loop.observers.append(observer)
        self._tables.append(table)

    def _close_tables(self) -> None:
        tables, self._tables = self._tables, []
        for table in tables:
            table.close()

    # ---------------------------------------------------------------- the present

    @property
    def fields(self) -> "xarray.Dataset":
        """Present values at the cell centres of all that the scenario computes: wind, gas, temperature.

        NaN in obstacles. The variables are those of `Run.fields`, such as u, v, `ethanol_ppm` and `temperature`.
        """
        return self._dataset(*(view.quantity.key for view in self._cells))

    @property
    def wind(self) -> "xarray.Dataset":
        """Present velocity of the air at the cell centres [m/s]: u, v and in 3-D w; NaN in obstacles."""
        return self._dataset("wind")

    @property
    def gas(self) -> "xarray.Dataset":
        """Present mole fraction of each gas at the cell centres [ppm], such as `ethanol_ppm`; NaN in obstacles.

        A gas with a background counts above the background, which is the attribute `background_ppm`.
        """
        return self._dataset(*(view.quantity.key for view in self._cells if view.quantity.unit == "ppm"))

    @property
    def temperature(self) -> "xarray.DataArray":
        """Present temperature of the air at the cell centres [K]; NaN in obstacles.

        Raises InputError if the scenario computes none.
        """
        if self.loop.wind.heat is None:
            raise InputError("the scenario computes no temperature; give wind.buoyancy.heat")
        return self._dataset("temperature").temperature

    @property
    def robots(self) -> "pandas.DataFrame":
        """Present state and readings of all robots, with the columns of `Run.robots`; units in ``attrs["units"]``.

        Raises InputError if the scenario has no robots.
        """
        from taichi_plume.results.run import data_frame

        return data_frame(self._rows())

    def plot(
        self,
        view: str | None = None,
        of: str = "gas",
        wind: bool = True,
        *,
        ax: "Axes | None" = None,
        figsize: tuple[float, float] | None = None,
    ) -> "Figure":
        """Return a figure of the present gas (or `of` "temperature") with its scale, the wind and the robots.

        view: "above", "column" or "section". view, ax, figsize: as of `Run.plot`. Raises InputError.
        """
        from taichi_plume.report.pictures import Shown, present
        from taichi_plume.report.plume import Present
        from taichi_plume.report.theme import Place
        from taichi_plume.results.tracks import tracks_of

        loop, place = self.loop, Place.of(ax, figsize)
        tracks = tracks_of(self._rows(True), self.scenario.robots) if loop.swarm.count else []
        with one_thread():
            seen = [view for view in self._observer.views if view.stored and view.plane.name != "cells"]
            data = self._observer.dataset(loop, seen)
        return present(
            Present(self.scenario, list(loop.obstacles)), data, Shown(view, of, None, wind), tracks, place
        )

    def _repr_html_(self) -> str:
        from taichi_plume.report.html import in_notebook
        from taichi_plume.report.theme import png

        if self._loop is None:
            return in_notebook([("simulation", "closed")])
        return in_notebook([(self.scenario.name, repr(self))], picture=png(self.plot()))

    def __repr__(self) -> str:
        if self._loop is None:
            return "Simulation, closed"
        return f"Simulation of {self.scenario.name}, t = {self.t:g} of {self.scenario.duration:g} s"

    # ---------------------------------------------------------------- parts

    @cached_property
    def _observer(self) -> Observer:
        """Observer of the recording's views, and of all cells."""
        loop = self.loop
        everywhere = cells_of(loop.grid.dim)
        whole = [View(each, everywhere, 1.0) for each in (wind(loop), *quantities(loop)) if each.in_cells]
        return Observer(loop, [*views(loop), *whole])

    @property
    def _cells(self) -> list[View]:
        return [view for view in self._observer.views if view.plane.name == "cells"]

    def _dataset(self, *keys: str) -> "xarray.Dataset":
        """Return the present values of quantities in all cells."""
        with one_thread():
            return self._observer.dataset(
                self.loop, [view for view in self._cells if view.quantity.key in keys]
            )

    def _rows(self, first_trial: bool = False) -> "pyarrow.Table":
        """Return the table of the robots at present; first_trial: only of the first trial of each group."""
        import pyarrow as pa

        from taichi_plume.execution.robots_table import RobotTable
        from taichi_plume.results.tracks import first_rows

        loop = self.loop
        if not loop.swarm.count:
            raise InputError("the scenario has no robots")
        table = RobotTable(loop, Path("robots.parquet"))
        with one_thread():
            table.sample(loop)
        rows = pa.Table.from_batches([table.take()])
        return first_rows(rows, self.scenario.robots) if first_trial else rows
