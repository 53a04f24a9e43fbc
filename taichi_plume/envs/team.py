"""A team in one trial, as PettingZoo has it: ``taichi_plume.envs.parallel_env(scenario=...)``."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Space
from pettingzoo import ParallelEnv

from taichi_plume.envs.picture import picture
from taichi_plume.envs.search import RENDER_FPS, drawable, opened, spaces
from taichi_plume.envs.task import actions_of, open_episodes, options_of, put_by, seeds_of
from taichi_plume.guard.terminal import visible
from taichi_plume.scenario.scenario import Scenario


class TeamEnv(ParallelEnv[str, np.ndarray, np.ndarray]):
    """The robots of a group that look for a source together: as many as its `count`, robot_0, robot_1 ...

    The episode is over for all of them at once. Else as `SearchEnv`. Raises ValueError, in a line for each fault.
    """

    metadata: ClassVar[dict[str, Any]] = {  # pyright: ignore[reportIncompatibleVariableOverride]
        "name": "taichi_plume_search_v0",
        "render_modes": ["rgb_array"],
        "render_fps": RENDER_FPS,
        "is_parallelizable": True,
    }

    def __init__(
        self,
        scenario: Scenario | dict[str, Any] | str | Path,
        render_mode: str | None = None,
        bank: Any = None,
        arch: str = "cpu",
        overrides: Sequence[str] = (),
        allow_outside: bool = False,
    ):
        self.render_mode = drawable(render_mode)
        given = {"bank": bank, "arch": arch, "overrides": overrides, "allow_outside": allow_outside}
        self.episodes: Any = open_episodes(scenario, 1, None, autoreset="disabled", **given)
        self.names = self.episodes.names
        self.possible_agents = [f"robot_{k}" for k in range(self.episodes.robots)]
        self.agents: list[str] = []
        several = [spaces(self.episodes) for _ in self.possible_agents]  # each with random numbers of its own
        self.observation_spaces = {
            a: seen for a, (seen, _) in zip(self.possible_agents, several, strict=True)
        }
        self.action_spaces = {a: done for a, (_, done) in zip(self.possible_agents, several, strict=True)}
        self._seeded = False

    def observation_space(self, agent: str) -> Space[np.ndarray]:
        """Of what a robot observes."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space[np.ndarray]:
        """Of what a robot can do."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, Any]]]:
        """Begin an episode: the first one of a seed, else the next one."""
        options_of(options)
        anew = seed is not None or not self._seeded
        opened(self.episodes).reset(seeds_of(seed, 1, np.random.default_rng()) if anew else None)
        self._seeded = True
        self.agents = list(self.possible_agents)
        return self._of(self.episodes.observations.copy()), {agent: {} for agent in self.agents}

    def step(self, actions: dict[str, np.ndarray]) -> tuple[dict, dict, dict, dict, dict]:
        """A decision of each robot. Raises ValueError where one is missing, no number or out of range."""
        episodes, agents = opened(self.episodes), self.agents
        if not agents:
            raise ValueError("the episode is over; reset the environment first")
        if not isinstance(actions, dict):
            raise ValueError(
                f"actions: got {visible(type(actions).__name__)}, wanted a dict of the agents' actions"
            )
        missing = [agent for agent in agents if agent not in actions]
        if missing:
            raise ValueError(f"actions: there is none of {', '.join(missing)}")
        episodes.step(np.stack([actions_of(actions[agent]) for agent in agents]))
        ends, late = bool(episodes.terminated[0]), bool(episodes.truncated[0])
        told = {name: float(values[0]) for name, values in episodes.info.items()} if ends or late else {}
        self.agents = [] if ends or late else agents
        rewards = {agent: float(reward) for agent, reward in zip(agents, episodes.rewards, strict=True)}
        return (
            self._of(episodes.observations.copy()),
            rewards,
            dict.fromkeys(agents, ends),
            dict.fromkeys(agents, late),
            {agent: dict(told) for agent in agents},
        )

    def render(self) -> np.ndarray | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The world as it is, seen from above, (height, width, 3); None where no render mode was given."""
        return picture(opened(self.episodes), 0) if self.render_mode else None

    def close(self) -> None:
        """Let go of everything."""
        put_by(self.episodes)
        self.episodes = None

    def _of(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        return dict(zip(self.possible_agents, rows, strict=True))
