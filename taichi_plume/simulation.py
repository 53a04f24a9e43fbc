"""The clock: order of advance, schedules, stop conditions, health. Knows its parts only by their protocols."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Mixture, Odour, Wind
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.series import Series
from taichi_plume.scenario.scenario import Scenario


class UnstableError(RuntimeError):
    """The numbers left what is physical; says where, when and what to change."""


class Sensors(Protocol):
    """What the robots measure with."""

    def measure(self, gas: Odour, wind: Wind, tick: int, t: float) -> None:
        """Update the readings of all robots."""
        ...


class Team(Protocol):
    """A search algorithm and its robots in the swarm, those of one or several groups."""

    numbers: tuple[int, ...]
    """Of the groups, by their place in the scenario."""
    algorithm: Any
    """What drives the robots."""

    @property
    def state_names(self) -> tuple[str, ...]:
        """What the robots' `state` means."""
        ...

    def act(self, tick: int, t: float, dt: float) -> None:
        """Turn readings into commands."""
        ...


class Mapper(Protocol):
    """An online gas map of all trials.

    cell: edge of its cells [m]. window: length of the snaps whose forecasts it makes [s]; None where it makes none.
    errors: (time [s], mean error [ppm] (trials,)) of each forecast that has been judged by the readings after it; none
    where the method makes none.

    Where the method tells how sure it is, there is also ``variance()`` (trials, nx, ny) [ppm²], see `Uncertain`.
    """

    cell: float
    window: float | None
    errors: Series

    def update(self, swarm: Any, t: float, dt: float) -> None:
        """Take in the readings at time t [s], the end of a tick of dt [s]."""
        ...

    def estimate(self) -> np.ndarray:
        """Concentration [ppm], (trials, nx, ny); NaN where nothing is known."""
        ...

    def weight(self) -> np.ndarray:
        """What stands behind the estimate, (trials, nx, ny), in the method's own measure; 0 where nothing is known."""
        ...


@runtime_checkable
class Uncertain(Mapper, Protocol):
    """A map that tells how sure it is.

    A reading to come has the variance ``variance() + noise`` about the estimate. Where the method reckons with what
    readings scatter, noise [ppm²] is 0; else variance() is how far the estimate may be off.
    """

    noise: float

    def variance(self) -> np.ndarray:
        """Variance [ppm²], (trials, nx, ny); NaN where nothing is known."""
        ...


@dataclass
class Every:
    """A function called with the simulation every `period` simulated seconds, at start and end as well."""

    STATE: ClassVar[tuple[str, ...]] = ("_period_done", "_last_tick")

    period: float
    function: Callable[["Simulation"], object]
    warm_up: bool = False
    """Whether it is called during the warm-up too."""
    _period_done: float = field(default=-float("inf"), repr=False)
    _last_tick: int | None = field(default=None, repr=False)

    def call_if_due(self, sim: "Simulation", force: bool = False) -> None:
        """Call the function when its next multiple of the period has come, or by `force`; once per tick at most."""
        if (sim.tick < 0 and not self.warm_up) or sim.tick == self._last_tick:
            return
        index = (sim.t + 1e-9 * sim.dt) // self.period
        if index > self._period_done or force:
            self._period_done, self._last_tick = index, sim.tick
            self.function(sim)


@dataclass
class EveryStep:
    """A function called with the simulation and its time [s]: at the begin, and after every step of the air."""

    STATE: ClassVar[tuple[str, ...]] = ("_step",)

    function: Callable[["Simulation", float], object]
    _step: int = field(default=-1, repr=False)

    def call_if_due(self, sim: "Simulation", t: float) -> None:
        """Call the function, once per step at most."""
        if sim.steps != self._step:
            self._step = sim.steps
            self.function(sim, t)


def check_gas(sim: "Simulation") -> None:
    """Raise UnstableError where the gas is no longer finite; the wind is checked at every step."""
    if not sim.gas.is_finite():
        raise UnstableError(
            f"the gas is no longer finite at t = {sim.t:.2f} s (step {sim.steps}); "
            "check the sources' rates and radii, or lower domain.spacing"
        )


@dataclass
class Simulation:
    """One run. Time t = tick dt is 0 when the robots start; the warm-up has negative ticks.

    A tick: wind and gas advance together in steps the wind can take, and the robots move as they were told; then
    they measure, then the maps, then they act, then what is due.
    """

    scenario: Scenario
    grid: Grid
    wind: Wind
    gas: Mixture
    swarm: Any
    sensors: Sensors
    teams: Sequence[Team]
    maps: Sequence[Mapper]
    obstacles: Sequence[Any]
    air: Air
    begin: Callable[[Scenario], Scenario] | None = None
    """Begins every part anew with the numbers of a scenario, and returns that completed; see `reset`."""
    forces: Callable[[], np.ndarray] | None = None
    """The force of the air on each obstacle [N], shape (obstacles, dim); None where it is not known."""
    pressure: Any = None
    """Field of the air's pressure over its density [m²/s²]; None where it is not known."""
    heat: Any = None
    """The air's temperature: `theta`, a field [K] above its `reference`; None where it is not computed."""
    observers: list[Every] = field(default_factory=list, init=False)
    """Called when they are due: append what shall watch the run."""
    step_observers: list[EveryStep] = field(default_factory=list, init=False)
    """Called after every step of the air."""
    tick: int = field(default=0, init=False)
    steps: int = field(default=0, init=False)
    wall_s: float = field(default=0.0, init=False)
    _begun: float | None = field(default=None, init=False, repr=False)

    STATE: ClassVar[tuple[str, ...]] = ("wind", "gas", "swarm", "sensors", "teams", "maps", "tick", "steps")

    def __post_init__(self) -> None:
        self.dt = self.scenario.tick
        self._at_begin()

    def _at_begin(self) -> None:
        self.tick, self.last_tick = self.scenario.first_tick, self.scenario.last_tick
        self.steps, self.wall_s = 0, 0.0
        self.observers = [Every(1.0, check_gas, warm_up=True)]
        self.step_observers = []

    def reset(self, scenario: Scenario | None = None) -> None:
        """Go back to the begin of the warm-up, with the numbers of `scenario`; unless given, with the same ones again.

        What follows equals a fresh simulation of that scenario to the bit, and nothing is compiled. It has to be of the
        structure of the one before: the same kinds, counts and shapes, see scenario/reset.py. The observers go, as they
        belong to a run. Raises ScenarioError, a line for each fault, and leaves the simulation as it was.
        """
        assert self.begin is not None, "made by hand, not assembled"
        self.scenario = self.begin(scenario or self.scenario)
        self._at_begin()

    @property
    def t(self) -> float:
        """Simulated time [s]."""
        return self.tick * self.dt

    @property
    def finished(self) -> bool:
        """Whether the time is over or no robot searches any more."""
        if self.tick >= self.last_tick:
            return True
        return self.scenario.stop_early and self.tick > 0 and self.swarm.count > 0 and self.swarm.all_over()

    def state_names(self) -> list[tuple[str, ...]]:
        """What the robots' `state` means, for each group."""
        names = {number: team.state_names for team in self.teams for number in team.numbers}
        return [names[number] for number in sorted(names)]

    def run(self) -> None:
        """Run to the end. Raises UnstableError; observers have been called up to the last good tick."""
        self._begun = time.perf_counter()
        try:
            self.observe()
            self._observe_step(self.t)
            while not self.finished:
                self.advance()
                self.observe()
            self.observe(force=True)
        finally:
            self.wall_s, self._begun = self.wall_so_far, None

    @property
    def wall_so_far(self) -> float:
        """Time of the clock [s] that the run has taken."""
        return self.wall_s + (time.perf_counter() - self._begun if self._begun is not None else 0.0)

    def observe(self, force: bool = False) -> None:
        """Call the observers that are due."""
        for observer in self.observers:
            observer.call_if_due(self, force)

    def advance(self) -> None:
        """One tick."""
        self._advance_air(self.t, self.dt)
        self.tick += 1
        if self.tick <= 0:
            return  # the robots are not there yet
        self.swarm.move(self.tick, self.t, self.dt)
        self.sensors.measure(self.gas, self.wind, self.tick, self.t)
        for gas_map in self.maps:
            gas_map.update(self.swarm, self.t, self.dt)
        for team in self.teams:
            team.act(self.tick, self.t, self.dt)

    def _advance_air(self, t: float, dt: float) -> None:
        """Wind and gas over one tick, interleaved so that the gas sees each step's flow."""
        end = t + dt
        limit = self._wind_limit(t)
        while end - t > 1e-9 * dt:
            step = (end - t) / max(1, ceil((end - t) / limit - 1e-9))
            self.wind.advance(t, step)
            limit = self._wind_limit(t + step)
            self.gas.advance(t, step)
            self.steps += 1
            t += step
            self._observe_step(t if end - t > 1e-9 * dt else (self.tick + 1) * self.dt)

    def _observe_step(self, t: float) -> None:
        for observer in self.step_observers:
            observer.call_if_due(self, t)

    def _wind_limit(self, t: float) -> float:
        """Longest step [s] of the wind from time t on. Raises UnstableError when it has blown up."""
        limit = self.wind.stable_dt(t)
        if not limit > 1e-6 * self.dt:
            courant = self.wind.diagnostics().get("max_courant", 0.0)
            raise UnstableError(
                f"the air flow is no longer finite at t = {self.t:.2f} s (step {self.steps}, Courant number up to "
                f"{courant:.2g}); lower wind.courant, or check the openings' speeds against the spacing"
            )
        return limit
