"""Engine of the environments: many episodes of a scenario at once, each with its own clock and world.

One trial is one environment. The world of an episode (film, start within the film, gas, mirror, start of the robots,
sensor units) and all random events depend only on the seed of the environment and the number of the episode, not on the
number of environments.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from math import ceil
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from taichi_plume.agents.commands import Commands
from taichi_plume.agents.members import Members
from taichi_plume.agents.observation import Observation, action_names
from taichi_plume.agents.placement import place
from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.agents.trials import Trials
from taichi_plume.assembly.assemble import ways
from taichi_plume.assembly.preparation import prepare
from taichi_plume.engine.process import one_thread
from taichi_plume.envs.bank import Bank, record
from taichi_plume.envs.step_kernel import (
    BEGIN,
    BEGIN_AGAIN,
    FIRST,
    INFO,
    KEEP,
    REST,
    STEP,
    Starts,
    StepKernel,
)
from taichi_plume.envs.task import require_task
from taichi_plume.envs.truth import Truth
from taichi_plume.grid.clearance import ClearanceMap
from taichi_plume.grid.rng import generator
from taichi_plume.guard.terminal import visible
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.starts import StartArea, StartAt
from taichi_plume.solvers.film_bank import FilmBank

MODES = ("next_step", "same_step", "disabled")
ARRAYS = ("numpy", "torch")
FALLBACKS = 64  # teams placed on the host, for scenarios with little free space
SLACK = 1e-6  # tolerance of the range of actions

Array: TypeAlias = Any
"""NumPy array, or a tensor of torch."""


@dataclass(frozen=True)
class Transition:
    """A step of all environments, from which a user's function computes rewards; n: number of robots in all.

    before, after (n, size): observations before and after the step; `names` are the names of their entries. actions
    (n, actions). rewards (n,): by `task.reward` of the scenario. terminated, truncated (num_envs,). info: state of the
    episodes, arrays (num_envs,) by key. All arrays are those of the engine: do not change or keep them.
    """

    before: Array
    actions: Array
    after: Array
    rewards: Array
    terminated: Array
    truncated: Array
    info: dict[str, Array]
    names: tuple[str, ...]
    read_truth: Callable[[], dict[str, Array]]

    @cached_property
    def truth(self) -> dict[str, Array]:
        """True state of the robots after the step, arrays over the n robots by key; see `Truth`."""
        return self.read_truth()


Rewarder: TypeAlias = Callable[[Transition], Any]
"""Function that returns the rewards (n,) of a step."""


class Episodes:
    """Engine of `count` environments of a scenario, each with `robots` learners of its first group of policies.

    bank: recorded flow realisations (airs), see envs/bank.py; recorded now unless given. autoreset: one of MODES, as in
    Gymnasium 1.x. arrays: "numpy", or "torch" for tensors on Taichi's device. The scenario must be checked.

    `observations` (count robots, size) stay valid for one further step. The next step overwrites all other arrays:
    `rewards` (count robots,), `terminated`, `truncated` (count,), `final_observations` (like observations, set for
    environments whose episode ended and restarted by `same_step`), and `info`, per environment (INFO in
    envs/step_kernel.py), of the episode of the last step. Raises ValueError with a one-line message if the scenario
    has no robots or has moving obstacles, ImportError without torch.
    """

    rewarder: Rewarder | None = None  # a user's reward function, instead of `task.reward`
    shows_truth = False  # whether `truth` and, for episodes restarted by `same_step`, `final_truth` are set

    def __init__(
        self,
        scenario: Scenario,
        folder: Path = Path(),
        count: int = 1,
        robots: int = 1,
        bank: Bank | None = None,
        autoreset: str = "next_step",
        arrays: str = "numpy",
    ):
        if autoreset not in MODES:
            raise ValueError(f"autoreset: got {autoreset}, allowed are {', '.join(MODES)}")
        if arrays not in ARRAYS:
            raise ValueError(f"arrays: got {arrays!r}, allowed are {', '.join(ARRAYS)}")
        scenario, resources = prepare(scenario, folder, allow_outside=True)
        if resources.faults:
            raise ScenarioError([f"{path}: {fault}" for path, fault in resources.faults.items()])
        require_task(scenario)
        group = learners(scenario, count, robots)
        clearance, _ = ways(scenario, resources, resources.site.cubes if resources.site else None)
        self.scenario, self.count, self.robots, self.autoreset = scenario, count, robots, autoreset
        tick, bank = scenario.tick, bank or record(scenario, folder, True)
        self.bank, films = bank, FilmBank(bank, count, robots, scenario.backgrounds)
        most = max(sum(len(places) for places in film) for film in bank.sources)
        dim = films.dim
        trials = Trials(count, robots, most, tick, dim)
        starts = Starts(group, _places(scenario, group, clearance))
        rows = np.arange(count) % len(starts.fallback)
        poses = starts.fallback[rows].reshape(-1, 2), np.zeros(count * robots)
        known = {"episodes": trials, "background": films.has_background}
        swarm = Swarm([group], *poses, clearance, np.empty((0, 2)), scenario.seed, **known)
        self.swarm, self.sensors = (
            swarm,
            Sensors(swarm, dim, tick, films.species, background=films.background),
        )
        members = Members(swarm, (0,))
        self.observation, self.commands = Observation(swarm, members, tick), Commands(swarm, members, tick)
        ticks = group.algorithm.ticks(tick)
        self.step_s, self.action_size = ticks * tick, self.commands.size
        self.action_names = action_names(group)
        self.most_steps = max(1, ceil(scenario.task.episode / self.step_s - 1e-6))
        self.names, self.low, self.high = self.observation.names, self.observation.low, self.observation.high
        self.kernel = StepKernel(self, films, bank, starts, ticks)
        self._truth = Truth(self)
        self._allocate(arrays)
        self._seeds = np.random.SeedSequence(scenario.seed).generate_state(count, np.uint64)

    def _allocate(self, arrays: str) -> None:
        """Allocate the arrays that kernels and users share; arrays: "numpy" or "torch"."""
        n, size = self.count * self.robots, self.observation.size
        if arrays == "torch":
            import torch  # pyright: ignore[reportMissingImports]

            from taichi_plume.engine.fields import on_cpu

            device = "cpu" if on_cpu() else "cuda"
            zeros, real, byte, boolean = (
                partial(torch.zeros, device=device),
                torch.float32,
                torch.uint8,
                torch.bool,
            )
            self._given = partial(torch.as_tensor, dtype=real, device=device)
        else:
            zeros, real, byte, boolean = np.zeros, np.float32, np.uint8, np.bool_
            self._given = partial(np.asarray, dtype=real)
        self._table: Array = zeros((3 * n, size), dtype=real)  # two in turn, and the final observations
        self._outcomes: Array = zeros((n + len(INFO) * self.count,), dtype=real)
        self._flags: Array = zeros(
            (3, self.count), dtype=byte
        )  # the action of `StepKernel`, terminated, truncated
        self._actions: Array = zeros((n, self.action_size), dtype=real)
        self._returns: Array = zeros((self.count,), dtype=real)  # of episodes, by the user's reward function
        self.truth: dict[str, Array] = {}
        self.final_truth: dict[str, Array] = {}
        self._views = self._table[:n], self._table[n : 2 * n]
        self.final_observations = self._table[2 * n :]
        self.rewards = self._outcomes[:n]
        info = self._outcomes[n:].reshape(len(INFO), self.count)
        self.info = {name: info[k] for k, name in enumerate(INFO)}
        self._todo = self._flags[0]
        self.terminated, self.truncated = self._flags[1].view(boolean), self._flags[2].view(boolean)
        self._side = 0
        self.observations = self._views[0]

    @one_thread()
    def reset(self, seeds: ArrayLike | None = None, mask: ArrayLike | None = None) -> None:
        """Begin episodes of all environments or, after the first reset, of those in the mask (count,).

        seeds: (count,) whole numbers from 0 to 2^64 - 1; by default the next episodes of the previous seeds. Only the
        first reset compiles kernels.
        """
        if not self.kernel.begun:
            mask = None  # all environments have to begin
        self._todo[:] = FIRST if seeds is not None or not self.kernel.begun else BEGIN
        if seeds is not None:
            given = np.asarray(seeds, np.uint64)
            chosen = np.ones(self.count, bool) if mask is None else np.asarray(mask, bool)
            self._seeds = np.where(chosen, given, self._seeds)
        if mask is not None:
            self._todo[~np.asarray(mask, bool)] = REST
        if seeds is not None or not self.kernel.begun:
            self.kernel.sow(self._seeds)
        self._run()
        self._returns[self._todo != REST] = 0.0
        self._show_truth()

    @one_thread()
    def step(self, actions: Array) -> None:
        """Advance all environments by one decision; actions: (count robots, action_size) from -1 to 1.

        Raises ValueError with a one-line message if an action is not a number or out of range, or if an episode is over
        and autoreset is disabled. The state does not change then.
        """
        if not self.kernel.begun:
            raise ValueError("no episode has begun; reset the environments first")
        self._take(actions)
        over = self.terminated | self.truncated
        if self.autoreset == "next_step":
            self._todo[:] = STEP + over  # BEGIN where the episode is over
        elif self.autoreset == "disabled" and over.any():
            raise ValueError(f"environment {int((1 * over).argmax())}: its episode is over; reset it first")
        else:
            self._todo[:] = STEP
        self._run()
        if self.rewarder is not None:
            self._reward(self.rewarder)
        self._show_truth()
        if self.autoreset == "same_step":
            over = self.terminated | self.truncated
            if over.any():
                self._todo[:] = KEEP + (BEGIN_AGAIN - KEEP) * over
                self.kernel.run(self._side, self._flags, self._actions, self._table, self._outcomes)
                if self.rewarder is not None:
                    self._returns[over] = 0.0
                self.final_truth = self.truth
                self._show_truth()

    def _reward(self, rewarder: Rewarder) -> None:
        """Replace the rewards of a step, and the returns of the episodes, by those of the user's function."""
        transition = Transition(
            self._views[1 - self._side], self._actions, self.observations, self.rewards, self.terminated,
            self.truncated, self.info, self.names, self.read_truth,
        )  # fmt: skip
        given = rewarder(transition)
        try:
            rewards = self._given(given)
        except (TypeError, ValueError, RuntimeError) as error:
            raise ValueError(f"reward: must return an array of numbers: {visible(error, 200)}") from None
        shape, expected = tuple(rewards.shape), tuple(self.rewards.shape)
        if shape != expected or not (abs(rewards) < np.inf).all():
            raise ValueError(f"reward: returned shape {shape}, must be finite numbers of shape {expected}")
        steps = self._todo == STEP  # the others begin an episode
        rewards = rewards.reshape(self.count, self.robots) * steps[:, None]
        self.rewards[:] = rewards.reshape(-1)
        self._returns[:] = self._returns * steps + rewards.sum(1) / self.robots
        self.info["return"][:] = self._returns

    def _show_truth(self) -> None:
        if self.shows_truth:
            self.truth = self.read_truth()

    def read_truth(self) -> dict[str, Array]:
        """Return the true state of the robots by key, see `Truth`; tensors if the engine's arrays are."""
        return {key: self._given(value) for key, value in self._truth.read().items()}

    def state(self) -> np.ndarray:
        """Return the global state of each environment for centralised training, see `Truth.state`."""
        return self._truth.state()

    def _run(self) -> None:
        self._side = 1 - self._side
        self.kernel.run(self._side, self._flags, self._actions, self._table, self._outcomes)
        self.observations = self._views[self._side]

    def _take(self, actions: Array) -> None:
        """Check the actions and copy them to the array that kernels read. Raises ValueError for invalid actions."""
        try:
            actions = self._given(actions)
        except (TypeError, ValueError, RuntimeError) as error:  # torch raises several types
            raise ValueError(f"actions: must be an array of numbers: {visible(error, 200)}") from None
        shape, expected = tuple(actions.shape), tuple(self._actions.shape)
        if shape != expected:
            raise ValueError(f"actions: got shape {shape}, must be {expected}")
        fair = abs(actions) <= 1.0 + SLACK  # False for NaN
        if not fair.all():
            row, k = divmod(int((1 - 1 * fair).reshape(-1).argmax()), self.action_size)
            raise ValueError(
                f"actions: environment {row // self.robots}: action {k} of robot {row % self.robots} is "
                f"{float(actions[row, k]):g}; must be from -1 to 1"
            )
        self._actions[:] = actions


def learners(scenario: Scenario, count: int, robots: int) -> Group:
    """Return the scenario's group of learners, changed to `count` trials of `robots` robots that start at once."""
    group = scenario.learners
    start = group.start
    if isinstance(start, StartAt):
        start = start.model_copy(update={"positions": start.positions[:robots]})
    return group.model_copy(
        update={"count": robots, "trials": count, "first_trial": 0, "begin": 0.0, "start": start}
    )


def _places(scenario: Scenario, group: Group, clearance: ClearanceMap) -> np.ndarray:
    """Return start positions without overlap for several teams, (teams, robots, 2) [m]. Raises ScenarioError."""
    teams = FALLBACKS if isinstance(group.start, StartArea) else 1
    teams_group = group.model_copy(update={"trials": teams})

    def draws(team: int) -> np.random.Generator:
        return generator(scenario.seed, f"start of team {team} of episodes")

    try:
        where, _ = place(teams_group, draws, clearance.distance_at)
    except ValueError as error:
        raise ScenarioError([f"robots.start: {error}"]) from None
    return where.reshape(teams, group.count, 2)
