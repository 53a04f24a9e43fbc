"""Single environment for Gymnasium with one robot: ``gymnasium.make("taichi_plume/Search-v0", scenario=...)``."""

from typing import ClassVar, Unpack

import gymnasium
import numpy as np
from gymnasium.spaces import Box

from taichi_plume.envs.episodes import Episodes
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


class SearchEnv(Environment, gymnasium.Env[np.ndarray, np.ndarray]):
    """Gymnasium environment in which one robot searches for a gas source.

    scenario: path of a YAML file, dict or Scenario; options: see `Options`. Observations are sensor data; see the keys
    of the learners' `algorithm`, and `names`, which names their entries. Actions are numbers from -1 to 1. `info` is
    empty until the step in which the episode ends; it then holds the numbers INFO of envs/step_kernel.py. With `truth`,
    `info` always has the key "truth". `render` returns an image (height, width, 3) from above if `render_mode` is
    "rgb_array". Raises ValueError with a line for each fault.
    """

    metadata: ClassVar[dict[str, object]] = {"render_modes": ["rgb_array"], "render_fps": RENDER_FPS}

    def __init__(self, scenario: Given, render_mode: str | None = None, **options: Unpack[Options]):
        episodes = self._open(scenario, 1, 1, render_mode, "disabled", **options)
        self.observation_space, self.action_space = spaces(episodes)

    def reset(
        self, *, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[np.ndarray, dict[str, object]]:
        """Begin the first episode of a seed, else the next episode; return the observation and the info."""
        options_of(options)
        super().reset(seed=seed)
        self._begin(seed, self.np_random)
        return self.episodes.observations[0].copy(), truth_of(self.episodes.truth, 0)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, object]]:
        """Advance by one decision. Raises ValueError if the action is invalid or the episode is over."""
        episodes = self.episodes
        episodes.step(actions_of(action)[None])
        over = bool(episodes.terminated[0]), bool(episodes.truncated[0])
        info = {**(outcome(episodes, 0) if any(over) else {}), **truth_of(episodes.truth, 0)}
        return episodes.observations[0].copy(), float(episodes.rewards[0]), *over, info


def spaces(episodes: Episodes) -> tuple[Box, Box]:
    """Return the observation space and the action space of one robot."""
    actions = (episodes.action_size,)
    return Box(episodes.low, episodes.high, dtype=np.float32), Box(-1.0, 1.0, actions, dtype=np.float32)
