"""One robot in one trial, as Gymnasium has it: ``gymnasium.make("taichi_plume/Search-v0", scenario=...)``."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.spaces import Box

from taichi_plume.envs.picture import picture
from taichi_plume.envs.task import actions_of, open_episodes, options_of, put_by, seeds_of
from taichi_plume.scenario.scenario import Scenario

RENDER_FPS = 10


class SearchEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """A robot that looks for a source of gas.

    scenario: path of a YAML file, dict or Scenario; bank: its recorded airs or their path, recorded now unless given;
    overrides: such as ``task.episode=30``, of a file. Observations are what its sensors give; see the keys of the
    learners' `algorithm`, and `names`. Actions are numbers from -1 to 1. Raises ValueError, in a line for each fault.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": RENDER_FPS}

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
        self.episodes: Any = open_episodes(scenario, 1, autoreset="disabled", **given)
        self.names = self.episodes.names
        self.observation_space, self.action_space = spaces(self.episodes)
        self._seeded = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode: the first one of a seed, else the next one."""
        options_of(options)
        super().reset(seed=seed)
        anew = seed is not None or not self._seeded
        opened(self.episodes).reset(seeds_of(seed, 1, self.np_random) if anew else None)
        self._seeded = True
        return self.episodes.observations[0].copy(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One decision. Raises ValueError where the action is no number, out of range, or the episode is over."""
        episodes = opened(self.episodes)
        episodes.step(actions_of(action)[None])
        over = bool(episodes.terminated[0]), bool(episodes.truncated[0])
        info = {name: float(values[0]) for name, values in episodes.info.items()} if any(over) else {}
        return episodes.observations[0].copy(), float(episodes.rewards[0]), *over, info

    def render(self) -> np.ndarray | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The world as it is, seen from above, (height, width, 3); None where no render mode was given."""
        return picture(opened(self.episodes), 0) if self.render_mode else None

    def close(self) -> None:
        """Let go of everything."""
        put_by(self.episodes)
        self.episodes = None


def spaces(episodes: Any) -> tuple[Box, Box]:
    """Of the observation and the action of a robot."""
    actions = (episodes.action_size,)
    return Box(episodes.low, episodes.high, dtype=np.float32), Box(-1.0, 1.0, actions, dtype=np.float32)


def opened(episodes: Any) -> Any:
    """The engine, which is not closed. Raises ValueError."""
    if episodes is None:
        raise ValueError("the environment is closed; make another one")
    return episodes


def drawable(render_mode: str | None) -> str | None:
    """A render mode that there is. Raises ValueError."""
    if render_mode not in (None, "rgb_array"):
        raise ValueError(f"render_mode: got '{render_mode}', allowed are None and 'rgb_array'")
    return render_mode
