"""Shared air: compute wind and gas once, record every time step (film), and play the film in all runs that share it."""

import os
import time
from collections import OrderedDict
from pathlib import Path

import numpy as np
import psutil

from taichi_plume.assembly.assemble import build
from taichi_plume.execution.execute import explain
from taichi_plume.files.shared_film import AirFilm, NewAirFilm
from taichi_plume.grid.fields import concentration_at
from taichi_plume.scenario.loading import ScenarioError, scenario_of
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.solvers.playback import VELOCITIES, TickFilm, variable
from taichi_plume.studies.air_plan import filmed
from taichi_plume.studies.messages import AirRecord, Task
from taichi_plume.studies.worker_process import PROCESS
from taichi_plume.time_loop import Every, TimeLoop

SHARE = 0.5  # fraction of the free memory per core for cached frames of films

# ---------------------------------------------------------------- filming


def solve_air(task: Task) -> AirRecord:
    """Solve the shared air of a task and write its film to `task.film`. A failure yields a record with the message."""
    begun, air = time.perf_counter(), task.requests[0].air
    try:
        frames, size = _solve(task)
    except Exception as error:
        message = "; ".join(error.faults) if isinstance(error, ScenarioError) else explain(error)[1]
        return AirRecord(air, time.perf_counter() - begun, 0, 0, " ".join(message.split()))
    return AirRecord(air, time.perf_counter() - begun, frames, size)


def _solve(task: Task) -> tuple[int, int]:
    """Compute the shared wind and gas, write the film, and return its number of frames and size in bytes."""
    assert task.film is not None
    scenarios = [scenario_of(task.base, request.changes) for request in task.requests]
    scenario = alone(scenarios[0], max(each.duration for each in scenarios))
    PROCESS.start()
    sim = build(PROCESS.prepared(scenario, task))
    wind, gases = filmed(sim.scenario)
    film = NewAirFilm(task.film, sim.grid.shape, _variables(sim.scenario), sim.dt, sim.last_tick + 1)
    shown = [n for n, (path, _) in enumerate(sim.scenario.gases) if path in gases]
    try:
        sim.observers.append(Every(sim.dt, lambda sim: film.append(_frame(sim, wind, shown))))
        sim.run()
        return film.count, film.close()
    except BaseException:
        film.discard()
        raise


def alone(scenario: Scenario, duration: float) -> Scenario:
    """Return the scenario without robots and recordings, for a duration [s]."""
    without = {"robots": (), "maps": (), "rivals": False} | dict.fromkeys(
        ("probes", "fields", "plumesim_log")
    )
    return scenario.model_copy(update={**without, "duration": duration})


def _frame(sim: TimeLoop, wind: bool, gases: list[int]) -> dict[str, np.ndarray]:
    """Return a frame: the present velocity and concentrations."""
    grid, frame = sim.grid, {}
    if wind:
        carrier = sim.wind.carrier
        assert carrier is not None
        frame |= {name: grid.read(u, 1) for name, u in zip(VELOCITIES, carrier.u, strict=False)}
    for k, n in enumerate(gases):
        frame[variable(k)] = _cells(sim, n)
    return frame


def _cells(sim: TimeLoop, n: int) -> np.ndarray:
    """Return the concentration of gas n [kg/m³] in the cells and one layer of ghost cells, from the gas solver."""
    gas, grid = sim.gas.gases[n], sim.grid
    if sim.scenario.gases[n][1].on_grid:
        field = gas.c  # pyright: ignore[reportAttributeAccessIssue]
        return grid.read(field, 1)
    cells = gas.cells(sim.t)
    if cells is None:
        cells = concentration_at(gas, grid.centers(), sim.t)
    inner = tuple(slice(grid.ghost - 1, 1 - grid.ghost) for _ in grid.shape)
    return grid.pad(np.asarray(cells, np.float32))[inner]


# ---------------------------------------------------------------- playing

_films: OrderedDict[tuple[str, int], AirFilm] = OrderedDict()  # open films with cached frames


def opened(path: Path) -> AirFilm:
    """Return the film at a path, from a cache that keeps frames between runs. Raises AirFilmError."""
    try:
        key = str(path), (path / "zarr.json").stat().st_mtime_ns
    except OSError:
        key = str(path), 0
    if key not in _films:
        held = sum(film.held for film in _films.values())
        room = int(SHARE * (psutil.virtual_memory().available + held) / (os.cpu_count() or 1))
        while _films and held > room / 2:
            held -= _films.popitem(last=False)[1].held
        _films[key] = AirFilm(path, room - held)
    _films.move_to_end(key)
    return _films[key]


def played(film: AirFilm, scenario: Scenario) -> TickFilm:
    """Return a film as the recording that a run plays.

    Raises ValueError if grid, time step, wind, gases or length of the film do not fit the scenario.
    """
    fits = film.shape == scenario.domain.shape and film.tick == scenario.tick
    if not fits or set(film.names) != set(_variables(scenario)):
        raise ValueError("the film of the air is of another grid, tick, wind or gas")
    if film.frames <= scenario.last_tick:
        raise ValueError(f"the film of the air ends at t = {film.times[-1]:g} s, before the run does")
    return TickFilm(film, *filmed(scenario))


def _variables(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the variables of a scenario's film."""
    wind, gases = filmed(scenario)
    return *VELOCITIES[: scenario.domain.dim if wind else 0], *map(variable, range(len(gases)))
