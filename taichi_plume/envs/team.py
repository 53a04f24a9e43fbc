"""Multi-agent environment for PettingZoo, a team in one trial: ``taichi_plume.envs.parallel_env(scenario=...)``."""

from typing import ClassVar, Unpack

import numpy as np
from gymnasium.spaces import Box, Space
from pettingzoo import ParallelEnv

from taichi_plume.envs.search import spaces
from taichi_plume.envs.task import (
    RENDER_FPS,
    Environment,
    Given,
    Options,
    actions_of,
    options_of,
    outcome,
    truth_of,
)
from taichi_plume.guard.terminal import visible


class TeamEnv(Environment, ParallelEnv[str, np.ndarray, np.ndarray]):
    """PettingZoo environment in which a team searches: a group's robots are the agents robot_0, robot_1 ...

    The episode ends for all agents at once. `state` is the global state for centralised training, within `state_space`.
    Otherwise as `SearchEnv`. Raises ValueError with a line for each fault.
    """

    metadata: ClassVar[dict[str, object]] = {  # pyright: ignore[reportIncompatibleVariableOverride]
        "name": "taichi_plume_search_v0",
        "render_modes": ["rgb_array"],
        "render_fps": RENDER_FPS,
        "is_parallelizable": True,
    }

    def __init__(self, scenario: Given, render_mode: str | None = None, **options: Unpack[Options]):
        episodes = self._open(scenario, 1, None, render_mode, "disabled", **options)
        self.possible_agents = [f"robot_{k}" for k in range(episodes.robots)]
        self.agents: list[str] = []
        several = {
            agent: spaces(episodes) for agent in self.possible_agents
        }  # each draws its own random numbers
        self.observation_spaces = {agent: pair[0] for agent, pair in several.items()}
        self.action_spaces = {agent: pair[1] for agent, pair in several.items()}
        size = episodes.state().shape[1]
        self.state_space = Box(-1.0, 1.0, (size,), np.float32)

    def state(self) -> np.ndarray:
        """Return the present poses and readings of all robots with the nearest source, see `Truth.state`."""
        return self.episodes.state()[0]

    def observation_space(self, agent: str) -> Space[np.ndarray]:
        """Return the observation space of an agent."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space[np.ndarray]:
        """Return the action space of an agent."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, object]]]:
        """Begin the first episode of a seed, else the next episode; return observations and infos by agent."""
        options_of(options)
        self._begin(seed, np.random.default_rng())
        self.agents = list(self.possible_agents)
        return self._of(self.episodes.observations.copy()), self._infos({})

    def step(self, actions: dict[str, np.ndarray]) -> tuple[dict, dict, dict, dict, dict]:
        """Advance by one decision; all dicts are by agent. Raises ValueError if an action is missing or invalid."""
        episodes, agents = self.episodes, self.agents
        if not agents:
            raise ValueError("the episode is over; reset the environment first")
        if not isinstance(actions, dict):
            given = visible(type(actions).__name__)
            raise ValueError(f"actions: got {given}, must be a dict of the agents' actions")
        missing = [agent for agent in agents if agent not in actions]
        if missing:
            raise ValueError(f"actions: missing for {', '.join(missing)}")
        episodes.step(np.stack([actions_of(actions[agent]) for agent in agents]))
        ends, late = bool(episodes.terminated[0]), bool(episodes.truncated[0])
        infos = self._infos(outcome(episodes, 0) if ends or late else {})
        self.agents = [] if ends or late else agents
        rewards = {agent: float(reward) for agent, reward in zip(agents, episodes.rewards, strict=True)}
        return (
            self._of(episodes.observations.copy()),
            rewards,
            dict.fromkeys(agents, ends),
            dict.fromkeys(agents, late),
            infos,
        )

    def _infos(self, info: dict[str, float]) -> dict[str, dict[str, object]]:
        """Return the info of each agent: a copy of `info` and, with the option `truth`, its true state."""
        truth = self.episodes.truth
        return {agent: {**info, **truth_of(truth, k)} for k, agent in enumerate(self.possible_agents)}

    def _of(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        return dict(zip(self.possible_agents, rows, strict=True))
