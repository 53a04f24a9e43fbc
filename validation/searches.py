"""Runs of experiments: search trials of robots in one or several airs with their statistics, and runs with probes."""

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from taichi_plume.agents.spiral import Spiral
from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import checked
from taichi_plume.engine import program, ti
from taichi_plume.execution.probes_table import ProbeTable
from taichi_plume.files.run_tables import read
from taichi_plume.grid import kernels
from taichi_plume.results.run import Run
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scoring.declarations import by_trial
from taichi_plume.scoring.trials import trial_outcomes, trial_summary
from taichi_plume.time_loop import Every, TimeLoop
from taichi_plume.validation.case import Keys
from taichi_plume.validation.experiment import Mean, Tracks, over_airs

if TYPE_CHECKING:
    import pyarrow as pa

Key = TypeVar("Key")
SHOWN = 6  # paths in the picture
WAY = "path / straight way"
QUANTITIES = {"success": "success_rate", "time [s]": "time_s", WAY: "overhead"}


def scenario_of(data: Keys, folder: Path = Path()) -> Scenario:
    """Return the checked scenario for the keys of a YAML file. Raises ScenarioError."""
    return checked(Scenario.model_validate(data), folder).scenario


def spread(trials: int, airs: int) -> list[int]:
    """Return the number of trials in each air, as even as possible; airs without trials are left out."""
    shares = [trials // airs + (k < trials % airs) for k in range(airs)]
    return [share for share in shares if share]


def afresh() -> None:
    """Restart Taichi on the same device, as it holds at most 512 trees of fields, and crashes beyond.

    For experiments that assemble many simulations one after the other; earlier simulations are lost.
    """
    program.start("cpu" if kernels.on_cpu() else ti.cfg.arch.name)


def outcomes(sim: TimeLoop, names: Container[str] | None = None) -> dict[str, dict[str, list[Any]]]:
    """Return the columns of `trial_outcomes` by group, of all groups or those in `names`; with SPIRAL's `escapes`."""
    snapshot = sim.swarm.snapshot()
    groups = [group for group in sim.swarm.groups if names is None or group.name in names]
    columns = {group.name: trial_outcomes(sim, group, snapshot) for group in groups}
    for team in sim.teams:
        if isinstance(team.algorithm, Spiral):
            escapes = np.zeros(sim.swarm.count, int)
            escapes[team.members.robot.to_numpy()] = team.algorithm.escapes.to_numpy()
            for group in team.members.groups:
                if group.name in columns:
                    columns[group.name]["escapes"] = by_trial(group, escapes).sum(axis=1).tolist()
    return columns


def pooled(parts: Iterable[tuple[Key, Mapping[str, Sequence[Any]]]]) -> dict[Key, dict[str, np.ndarray]]:
    """Return the columns of several parts joined by key; parts: (key, columns)."""
    columns: dict[Key, dict[str, list[Any]]] = {}
    for key, part in parts:
        for name, values in part.items():
            columns.setdefault(key, {}).setdefault(name, []).extend(values)
    return {key: {name: np.array(values) for name, values in part.items()} for key, part in columns.items()}


def first_trials(
    scene: Callable[[int, list[Keys], float], Keys],
    groups: Mapping[Key, Callable[[int], Keys]],
    trials: int,
    airs: int,
    limit: float,
) -> dict[Key, dict[str, np.ndarray]]:
    """Return the outcomes of searches that all start at time 0, by row, with `time` [s] and `air`.

    scene: scenario for an air, groups and a duration [s]. groups: for each row the group of so many trials. Searches
    end at `limit` [s]; failures count with this time.
    """
    parts = []
    for air, share in enumerate(spread(trials, airs)):
        robots = {row: group(share) for row, group in groups.items()}
        afresh()
        columns = contest(scene(air, list(robots.values()), limit), limit=limit)
        for row, group in robots.items():
            outcomes = columns[group["name"]]
            time = np.where(outcomes["success"], outcomes["time_s"], limit).tolist()
            parts.append((row, outcomes | {"time": time, "air": [air] * share}))
    return pooled(parts)


class Searches:
    """Collection of search trials: those of the first group of several runs, each in its own air."""

    def __init__(self) -> None:
        self.columns: dict[str, list[Any]] = {}
        self.ways: list[np.ndarray] = []
        self.airs: list[int] = []  # air of each trial

    def add(self, sim: TimeLoop) -> None:
        """Run a simulation and add the trials of its first group."""
        group = sim.swarm.groups[0]
        places: list[np.ndarray] = []
        sim.observers.append(
            Every(0.5, lambda sim: places.append(sim.swarm.position.to_numpy()[group.slice]))
        )
        sim.run()
        for name, values in outcomes(sim)[group.name].items():
            self.columns.setdefault(name, []).extend(values)
        self.ways += list(np.stack(places, axis=1))
        self.airs += [max(self.airs, default=-1) + 1] * group.trials

    def add_run(self, run: Run) -> None:
        """Add the trials of the first group of a finished run with one robot per trial."""
        name = run.trials["group"].iloc[0]
        trials = run.trials[run.trials["group"] == name]
        for column in trials.columns:
            self.columns.setdefault(column, []).extend(trials[column].tolist())
        robots = run.robots[run.robots["group"] == name]  # in the order of time
        for _, rows in robots.groupby("trial"):
            self.ways.append(np.column_stack([rows["x"], rows["y"]]))
        self.airs += [max(self.airs, default=-1) + 1] * len(trials)

    def summary(self, scenario: Scenario, title: str) -> dict[str, Mean | Tracks]:
        """Return the means over all trials, and a picture of some paths, up to half of them of failures.

        With several airs the intervals are over airs.
        """
        size, (_, source) = scenario.domain.extent[:2], scenario.sources[0]
        good = np.array(self.columns["success"], bool)
        lost = _evenly(np.flatnonzero(~good), SHOWN // 2)
        shown = [*lost, *_evenly(np.flatnonzero(good), SHOWN - len(lost))]
        ways = tuple(self.ways[k] for k in shown)
        return {
            **self._means(scenario.duration),
            title: Tracks((size[0], size[1]), (source.position[0], source.position[1]), ways),
        }

    def _means(self, duration: float) -> dict[str, Mean]:
        if max(self.airs) == 0:
            summary = trial_summary(self.columns, duration)
            return {name: Mean(**summary[key]) for name, key in QUANTITIES.items()}
        airs, means = np.array(self.airs), {}
        for name, key in QUANTITIES.items():
            share = key == "success_rate"
            values = np.array(self.columns["success" if share else key], float)
            means[name] = over_airs(values, airs, share)
        return means


def _evenly(numbers: np.ndarray, most: int) -> np.ndarray:
    """Return at most `most` of these numbers, evenly spaced."""
    return numbers[np.linspace(0, len(numbers) - 1, min(most, len(numbers))).astype(int)]


def searches(
    airs: Iterable[Keys], trials: Sequence[int], title: str, folder: Path = Path()
) -> dict[str, Mean | Tracks]:
    """Run the first group of each scenario with its number of trials; return means and a picture of paths.

    Taichi must have been started.
    """
    trials_by_air, scenario = Searches(), None
    for data, count in zip(airs, trials, strict=True):
        group = data["robots"][0] | {"trials": count}
        scenario = scenario_of(data | {"robots": [group]}, folder)
        trials_by_air.add(assemble(scenario, folder))
    assert scenario is not None
    return trials_by_air.summary(scenario, title)


def contest(data: Keys, folder: Path = Path(), limit: float = inf) -> dict[str, dict[str, list[Any]]]:
    """Run a scenario with its groups as rivals; return the columns of `trial_outcomes` by group. limit: see `race`."""
    return race(assemble(scenario_of(data | {"rivals": True}, folder), folder), limit)


def race(sim: TimeLoop, limit: float) -> dict[str, dict[str, list[Any]]]:
    """Run the searches of a simulation; return the columns of `trial_outcomes` by group.

    limit: duration of each search [s], from the start of its group; the run ends with the last search.
    """
    results: dict[str, dict[str, list[Any]]] = {}
    late = {group.name: group.model.begin + limit for group in sim.swarm.groups}
    sim.observe()
    while not sim.finished and late:
        sim.advance()
        sim.observe()
        over = [name for name, end in late.items() if sim.t >= end]
        if over:
            results |= outcomes(sim, over)
            late = {name: end for name, end in late.items() if name not in results}
    return results | outcomes(sim, late)


def probed(data: Keys, sim: TimeLoop | None = None) -> tuple[TimeLoop, np.ndarray, "pa.Table"]:
    """Run a scenario with probes; return the simulation at its end, the times (n,) [s], and the table of the probes.

    The table has all points of each time. sim: simulation to reset instead of assembling another one. Taichi must have
    been started.
    """
    if sim is None:
        sim = assemble(scenario_of(data))
    else:
        sim.reset(scenario_of(data))
    model = sim.scenario.probes
    assert model is not None
    with TemporaryDirectory() as folder:
        table = ProbeTable(sim, Path(folder) / "probes.parquet", model)
        sim.step_observers.append(table.observer())
        table.start()
        sim.run()
        table.close()
        readings = read(table.path)
    return sim, readings["t"].to_numpy()[:: model.size], readings
