"""Time loop of a simulation: time steps (CFL limit), schedules of observers, stop conditions, checks for blow-up.

The components of a simulation are known only by their protocols.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from taichi_plume.agents import decisions
from taichi_plume.grid.blas import one_blas_thread
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import Mixture, Odour, Wind
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.series import Series
from taichi_plume.grid.state import State
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.scenario import Scenario

if TYPE_CHECKING:
    from taichi_plume.agents.gas_map import Readers
    from taichi_plume.agents.received_readings import ReceivedReadings
    from taichi_plume.agents.swarm import Swarm
    from taichi_plume.files.gaden import Cubes
    from taichi_plume.grid.shapes import Shape
    from taichi_plume.scenario.maps import Levels


class UnstableError(RuntimeError):
    """Error of a solution that is no longer finite; the message says where, when and what to change."""


class Sensors(Protocol):
    """Protocol of the gas sensors and anemometers of all robots."""

    def measure(self, gas: Odour, wind: Wind, tick: int, t: float) -> None:
        """Update the readings of all robots from gas and wind at time t [s]; tick: number of the time step."""
        ...


class Team(Protocol):
    """Interface (typing.Protocol) of a search algorithm together with its robots, from one or several groups."""

    numbers: tuple[int, ...]
    """Indices of the groups in the scenario."""
    algorithm: Any
    """The search algorithm that commands the robots."""
    members: Any
    """Robots of the algorithm, see `agents.members`."""

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the algorithm's states, indexed by the robots' `state`."""
        ...

    def act(self, tick: int, t: float, dt: float) -> None:
        """Convert readings at time t [s] into commands for the next dt [s]."""
        ...


class Mapper(Protocol):
    """Protocol of an online gas map over all trials.

    cell: edge of the cells [m]. levels: layers of a map in three dimensions, None on the floor. window: length of the
    snapshots that are forecast [s]; None without forecasts. errors: (time [s], mean error [ppm] (trials,)) of each
    forecast that was compared with later readings. Methods that estimate their variance are `Uncertain`.
    """

    cell: float
    levels: "Levels | None"
    window: float | None
    errors: Series

    def update(self, swarm: "Readers", t: float, dt: float) -> None:
        """Add the robots' readings at time t [s], the end of a time step of dt [s]."""
        ...

    def estimate(self) -> np.ndarray:
        """Return the estimated concentration [ppm], (trials, nx, ny), with layers (trials, nx, ny, nz); NaN in unknown
        cells.
        """
        ...

    def weight(self) -> np.ndarray:
        """Return the weight of the readings in each cell's estimate, (trials, nx, ny); 0 without readings.

        The scale of the weights depends on the kind of map.
        """
        ...


@runtime_checkable
class Uncertain(Mapper, Protocol):
    """Protocol of a gas map that also estimates its variance.

    A future reading has the variance ``variance() + noise`` about the estimate. If the method includes the scatter of
    readings in variance(), noise [ppm²] is 0; else variance() is that of the estimate alone.
    """

    noise: float

    def variance(self) -> np.ndarray:
        """Return the variance of the estimate [ppm²], (trials, nx, ny); NaN in unknown cells."""
        ...


@dataclass
class Every:
    """Observer: function called with the simulation every `period` simulated seconds, and at start and end."""

    STATE: ClassVar[tuple[str, ...]] = ("_period_done", "_last_tick")

    period: float
    function: Callable[["TimeLoop"], object]
    warm_up: bool = False
    """Whether the function is also called during the warm-up."""
    _period_done: float = field(default=-float("inf"), repr=False)
    _last_tick: int | None = field(default=None, repr=False)

    def call_if_due(self, sim: "TimeLoop", force: bool = False) -> None:
        """Call the function if a multiple of `period` was reached or `force` is set; at most once per time step."""
        if (sim.tick < 0 and not self.warm_up) or sim.tick == self._last_tick:
            return
        index = (sim.t + 1e-9 * sim.dt) // self.period
        if index > self._period_done or force:
            self._period_done, self._last_tick = index, sim.tick
            self.function(sim)


@dataclass
class EveryStep:
    """Observer: function called with the simulation and the time [s], at the start and after every step of the flow."""

    STATE: ClassVar[tuple[str, ...]] = ("_step",)

    function: Callable[["TimeLoop", float], object]
    _step: int = field(default=-1, repr=False)

    def call_if_due(self, sim: "TimeLoop", t: float) -> None:
        """Call the function with the simulation and time t [s], at most once per step of the flow."""
        if sim.steps != self._step:
            self._step = sim.steps
            self.function(sim, t)


def check_gas(sim: "TimeLoop") -> None:
    """Raise UnstableError if the gas is no longer finite. (The wind is checked at every step.)"""
    if not sim.gas.is_finite():
        raise UnstableError(
            f"the gas is no longer finite at t = {sim.t:.2f} s (step {sim.steps}); "
            "check the sources' rates and radii, or lower domain.spacing"
        )


@dataclass
class TimeLoop:
    """Run of a scenario in time steps (ticks) of dt [s]. t = tick dt is 0 when robots start, negative in the warm-up.

    Order of a time step: wind and gas advance together in substeps within the wind's CFL limit, robots move by their
    commands, sensors measure, maps add the readings, algorithms act, and observers that are due are called.
    """

    scenario: Scenario
    grid: Grid
    wind: Wind
    gas: Mixture
    swarm: "Swarm"
    sensors: Sensors
    teams: Sequence[Team]
    maps: Sequence[Mapper]
    obstacles: "Sequence[Shape | Cubes]"
    air: Air
    rebuild: Callable[..., "TimeLoop"] | None = None
    """Function that returns a new simulation of a scenario; files that both scenarios name are not opened again.

    The optional second argument is a running simulation whose state is restored next: users' algorithms with equal
    parameters then stay the same objects.
    """
    forces: Callable[[], np.ndarray] | None = None
    """Force of the air on each obstacle [N], shape (obstacles, dim); None if unknown."""
    received: "Mapping[int, ReceivedReadings]" = field(default_factory=dict)
    """Readings that reach the robots that make maps, by the number of the robot."""
    observers: list[Every] = field(default_factory=list, init=False)
    """Observers that are called when they are due; append your own."""
    step_observers: list[EveryStep] = field(default_factory=list, init=False)
    """Observers that are called after every step of the air."""
    tick: int = field(default=0, init=False)
    steps: int = field(default=0, init=False)
    wall_s: float = field(default=0.0, init=False)
    _begun: float | None = field(default=None, init=False, repr=False)

    STATE: ClassVar[tuple[str, ...]] = ("wind", "gas", "swarm", "sensors", "teams", "maps", "tick", "steps")

    def __post_init__(self) -> None:
        self.dt = self.scenario.tick
        self.tick, self.last_tick = self.scenario.first_tick, self.scenario.last_tick
        self.steps, self.wall_s, self._begun = 0, 0.0, None
        self.observers = [Every(1.0, check_gas, warm_up=True)]

    @one_blas_thread
    def reset(self, scenario: Scenario | None = None) -> None:
        """Return to the start of the warm-up, with `scenario` or, unless given, with the same scenario.

        The simulation becomes a new one, with new components and no observers. Files that both scenarios name are not
        opened again. Raises ScenarioError, a line for each fault, or OwnAlgorithmError, and leaves the simulation as it
        was.
        """
        assert self.rebuild is not None, "not assembled"
        vars(self).update(vars(self.rebuild(scenario or self.scenario)))

    @one_blas_thread
    def change(self, scenario: Scenario) -> None:
        """Give the simulation the parameters of a scenario during the run; state and observers stay.

        Raises ScenarioError if the state does not fit the scenario, or OwnAlgorithmError, and leaves the simulation as
        it was.
        """
        assert self.rebuild is not None, "not assembled"
        saved, new = State(self).save(), self.rebuild(scenario, self)
        if self.gas.has_background != new.gas.has_background:
            background = "gas.background: from 0 or to 0 ppm it cannot change during a run; use reset"
            raise ScenarioError([background])
        state = State(new)
        reason = state.unlike(saved)
        if reason is not None:
            raise ScenarioError([f"{reason}; cannot change during a run; use reset"])
        state.restore(saved)
        observers = {name: vars(self)[name] for name in ("observers", "step_observers", "wall_s", "_begun")}
        vars(self).update(vars(new) | observers)

    @property
    def t(self) -> float:
        """Present simulated time [s]."""
        return self.tick * self.dt

    @property
    def finished(self) -> bool:
        """True if the end time is reached or, with `stop_early`, no robot searches any more."""
        if self.tick >= self.last_tick:
            return True
        return self.scenario.stop_early and self.tick > 0 and self.swarm.count > 0 and self.swarm.all_over()

    def state_names(self) -> list[tuple[str, ...]]:
        """Return the names of the algorithm's states for each group, indexed by the robots' `state`."""
        names = {number: team.state_names for team in self.teams for number in team.numbers}
        return [names[number] for number in sorted(names)]

    def decision_columns(self) -> tuple[decisions.Decision, ...]:
        """Return the decision quantities of the algorithms that drive robots."""
        return decisions.columns(self.teams)

    def decisions(self) -> dict[str, np.ndarray]:
        """Return the decision quantities of all robots, (count,) by name; NaN for robots of other algorithms."""
        return decisions.values(self.teams, self.swarm.count)

    @one_blas_thread
    def run(self) -> None:
        """Run the simulation to its end. Raises UnstableError; observers were called up to the last good step."""
        self._begun = time.perf_counter()
        try:
            while not self.finished:
                self.step()
            self.observe(force=True)
        finally:
            self.wall_s, self._begun = self.wall_so_far, None

    @one_blas_thread
    def step(self) -> None:
        """Advance by a time step (tick). Observers that are due are called, before the first step for its start."""
        self.observe()
        self._observe_step(self.t)
        self.advance()
        self.observe()

    @property
    def wall_so_far(self) -> float:
        """Wall-clock time of the run so far [s]."""
        return self.wall_s + (time.perf_counter() - self._begun if self._begun is not None else 0.0)

    def observe(self, force: bool = False) -> None:
        """Call the observers that are due, or with `force` all of them."""
        for observer in self.observers:
            observer.call_if_due(self, force)

    @one_blas_thread
    def advance(self) -> None:
        """Advance the simulation by a time step (tick): air, robots, sensors, maps and algorithms."""
        self._advance_air(self.t, self.dt)
        self.tick += 1
        if self.tick > 0:  # the warm-up has no robots
            self.advance_robots(self.teams)

    @one_blas_thread
    def advance_robots(self, teams: Sequence[Team]) -> None:
        """Carry out the time step that ends at the present time: robots, sensors, maps, and algorithms of `teams`."""
        self.swarm.move(self.tick, self.t, self.dt)
        self.sensors.measure(self.gas, self.wind, self.tick, self.t)
        for received in self.received.values():
            received.receive(self.tick)
        for model, gas_map in zip(self.scenario.maps, self.maps, strict=True):
            readers = self.swarm if model.robot is None else self.received[model.robot]
            gas_map.update(readers, self.t, self.dt)
        for team in teams:
            team.act(self.tick, self.t, self.dt)

    def _advance_air(self, t: float, dt: float) -> None:
        """Advance wind and gas from t to t + dt [s], interleaved so that the gas sees the flow of each step."""
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
        """Return the longest stable step [s] of the wind from time t on (CFL). Raises UnstableError after a blow-up."""
        limit = self.wind.stable_dt(t)
        if not limit > 1e-6 * self.dt:
            courant = self.wind.diagnostics().get("max_courant", 0.0)
            raise UnstableError(
                f"the air flow is no longer finite at t = {self.t:.2f} s (step {self.steps}, Courant number up to "
                f"{courant:.2g}); lower wind.courant, or check the openings' speeds against the spacing"
            )
        return limit
