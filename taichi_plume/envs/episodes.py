"""The engine of the environments: many episodes of a scenario at once, each with a clock and a world of its own.

One trial is one environment. What an episode is like (its film, the moment at which it sets in, the gas, whether it is
seen in a mirror, the start, the sensors' units) and all that happens in it by chance is drawn from the seed of its
environment and the number of the episode: it does not depend on how many environments there are beside it.
"""

from functools import partial
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.agents.commands import Commands
from taichi_plume.agents.members import Members
from taichi_plume.agents.observation import Observation
from taichi_plume.agents.placement import place
from taichi_plume.agents.sensors import Sensors
from taichi_plume.agents.swarm import Swarm
from taichi_plume.agents.trials import Trials
from taichi_plume.assembly.assemble import ways
from taichi_plume.assembly.prepare import prepare
from taichi_plume.envs.bank import record
from taichi_plume.envs.rounds import BEGIN, BEGIN_AGAIN, FIRST, INFO, KEEP, REST, STEP, Rounds, Starts
from taichi_plume.envs.task import require_task
from taichi_plume.grid.rng import generator
from taichi_plume.guard.terminal import visible
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.robots import Group
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scenario.starts import StartArea, StartAt
from taichi_plume.solvers.film_bank import FilmBank

MODES = ("next_step", "same_step", "disabled")
ARRAYS = ("numpy", "torch")
FALLBACKS = 64  # teams placed on the host, for where hardly any room is left
SLACK = 1e-6  # by which an action may be out of range


class Episodes:
    """`count` environments of a scenario, each with `robots` learners of its first group of policies, in recorded airs.

    bank: the recorded airs, see envs/bank.py; recorded now unless given. autoreset: as Gymnasium 1.x defines it, one of
    MODES. arrays: "numpy", or "torch" for tensors on Taichi's device. Of the scenario nothing may be wrong.

    Arrays are overwritten by the next step, but for `observations`, of which the last one stays valid until the step
    after the next: (count robots, size). `rewards` (count robots,), `terminated`, `truncated` (count,),
    `final_observations` like observations, set where an episode ended and `same_step` has begun the next one, and
    `info`, per environment (INFO in envs/rounds.py), of the episode that went on or ended in the last step.
    Raises ValueError, in a line, where the scenario has no robots or obstacles that walk, ImportError without torch.
    """

    def __init__(
        self,
        scenario: Scenario,
        folder: Path = Path(),
        count: int = 1,
        robots: int = 1,
        bank: Any = None,
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
        tick, self.bank = scenario.tick, bank if bank is not None else record(scenario, folder, True)
        bank = self.bank
        films = FilmBank(bank, count, robots)
        most = max(sum(len(places) for places in film) for film in bank.sources)
        trials = Trials(count, robots, most, tick)
        starts = Starts(group, _places(scenario, group, clearance))
        rows = np.arange(count) % len(starts.fallback)
        poses = starts.fallback[rows].reshape(-1, 2), np.zeros(count * robots)
        swarm = Swarm([group], *poses, clearance, np.empty((0, 2)), scenario.seed, episodes=trials)
        self.swarm, self.sensors = swarm, Sensors(swarm, 2, tick, films.species)
        members = Members(swarm, (0,))
        self.observation, self.commands = Observation(swarm, members, tick), Commands(swarm, members, tick)
        self.observation.begin()
        self.commands.begin()
        ticks = group.algorithm.ticks(tick)
        self.step_s, self.action_size = ticks * tick, self.commands.size
        self.most_steps = max(1, ceil(scenario.task.episode / self.step_s - 1e-6))
        self.names, self.low, self.high = self.observation.names, self.observation.low, self.observation.high
        self.rounds = Rounds(self, films, bank, starts, ticks)
        self.arrays = arrays
        self.begin()

    told: str = ""  # what it is made of, and Taichi's runtime that it is made in: see `task.open_episodes`
    runs_in: Any = None

    def begin(self) -> None:
        """As made, with other arrays: no episode has begun. Compiles nothing."""
        self._allocate(self.arrays)
        self.rounds.begun = False
        self._seeds = np.random.SeedSequence(self.scenario.seed).generate_state(self.count, np.uint64)

    def _allocate(self, arrays: str) -> None:
        """Make all arrays that kernels and users share."""
        n, size = self.count * self.robots, self.observation.size
        zeros: Any
        kinds: Any
        if arrays == "torch":
            import torch  # pyright: ignore[reportMissingImports]

            from taichi_plume.grid.kernels import on_cpu

            zeros = partial(torch.zeros, device="cpu" if on_cpu() else "cuda")
            kinds = torch.float32, torch.uint8, torch.bool
            self._given = partial(torch.as_tensor, dtype=kinds[0], device=zeros.keywords["device"])
        else:
            zeros, kinds = np.zeros, (np.float32, np.uint8, np.bool_)
            self._given = partial(np.asarray, dtype=np.float32)
        real, byte, boolean = kinds
        self._table: Any = zeros((3 * n, size), dtype=real)  # two in turn, and the final ones
        self._outcomes: Any = zeros((n + len(INFO) * self.count,), dtype=real)
        self._flags: Any = zeros((3, self.count), dtype=byte)  # what to do, terminated, truncated
        self._actions: Any = zeros((n, self.action_size), dtype=real)
        self._views = self._table[:n], self._table[n : 2 * n]
        self.final_observations = self._table[2 * n :]
        self.rewards = self._outcomes[:n]
        told = self._outcomes[n:].reshape(len(INFO), self.count)
        self.info = {name: told[k] for k, name in enumerate(INFO)}
        self._todo = self._flags[0]
        self.terminated, self.truncated = self._flags[1].view(boolean), self._flags[2].view(boolean)
        self._side = 0
        self.observations = self._views[0]

    def reset(self, seeds: Any = None, mask: Any = None) -> None:
        """Begin episodes: of all environments, or those of the mask (count,).

        seeds: (count,) whole numbers from 0 to 2^64 - 1; unless given, the next episodes of the seeds before. The first
        time all begin. Compiles nothing after that.
        """
        if not self.rounds.begun:
            mask = None  # all have to begin
        self._todo[:] = FIRST if seeds is not None or not self.rounds.begun else BEGIN
        if seeds is not None:
            given = np.asarray(seeds, np.uint64)
            chosen = np.ones(self.count, bool) if mask is None else np.asarray(mask, bool)
            self._seeds = np.where(chosen, given, self._seeds)
        if mask is not None:
            self._todo[~np.asarray(mask, bool)] = REST
        if seeds is not None or not self.rounds.begun:
            self.rounds.sow(self._seeds)
        self._run()

    def step(self, actions: Any) -> None:
        """One decision of each robot, (count robots, action_size) from -1 to 1.

        Raises ValueError, in a line, where one is no number or out of range, or where an episode is over that nobody
        begins anew; nothing has moved then.
        """
        if not self.rounds.begun:
            raise ValueError("no episode has begun; reset the environments first")
        self._take(actions)
        over = self._flags[1] | self._flags[2]
        if self.autoreset == "next_step":
            self._todo[:] = STEP + over  # BEGIN where it is over
        elif self.autoreset == "disabled" and over.any():
            raise ValueError(f"environment {int(over.argmax())}: its episode is over; reset it first")
        else:
            self._todo[:] = STEP
        self._run()
        if self.autoreset == "same_step":
            over = self._flags[1] | self._flags[2]
            if over.any():
                self._todo[:] = KEEP + (BEGIN_AGAIN - KEEP) * over
                self.rounds.run(self._side, self._flags, self._actions, self._table, self._outcomes)

    def _run(self) -> None:
        self._side = 1 - self._side
        self.rounds.run(self._side, self._flags, self._actions, self._table, self._outcomes)
        self.observations = self._views[self._side]

    def _take(self, actions: Any) -> None:
        """Copy the actions to where kernels read them."""
        try:
            actions = self._given(actions)
        except (TypeError, ValueError, RuntimeError) as error:  # torch has several
            raise ValueError(f"actions: wanted an array of numbers: {visible(error, 200)}") from None
        if tuple(actions.shape) != tuple(self._actions.shape):
            raise ValueError(
                f"actions: got shape {tuple(actions.shape)}, wanted {tuple(self._actions.shape)}"
            )
        fair = abs(actions) <= 1.0 + SLACK  # of NaN it is not
        if not fair.all():
            first = int((1 - 1 * fair).reshape(-1).argmax())
            row, k = divmod(first, self.action_size)
            raise ValueError(
                f"actions: environment {row // self.robots}: action {k} of robot {row % self.robots} is "
                f"{float(actions[row, k]):g}; wanted numbers from -1 to 1"
            )
        self._actions[:] = actions


def learners(scenario: Scenario, count: int, robots: int) -> Group:
    """The group of learners, as so many trials of so many robots that set off at once."""
    group = scenario.learners
    start = group.start
    if isinstance(start, StartAt):
        start = start.model_copy(update={"positions": start.positions[:robots]})
    return group.model_copy(
        update={"count": robots, "trials": count, "first_trial": 0, "begin": 0.0, "start": start}
    )


def _places(scenario: Scenario, group: Group, clearance: Any) -> np.ndarray:
    """Places of some teams, (teams, robots, 2) [m], free of overlap."""
    teams = FALLBACKS if isinstance(group.start, StartArea) else 1
    some = group.model_copy(update={"trials": teams})

    def draws(team: int) -> np.random.Generator:
        return generator(scenario.seed, f"start of team {team} of episodes")

    try:
        where, _ = place(some, draws, clearance.distance_at)
    except ValueError as error:
        raise ScenarioError([f"robots.start: {error}"]) from None
    return where.reshape(teams, group.count, 2)
