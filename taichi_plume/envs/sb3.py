"""Thousands of trials at once for stable-baselines3: ``SearchVecEnv("task.yaml", 512)`` is a VecEnv.

It is no Gymnasium vector environment: episodes that end begin anew in the same step, `infos` holds a dict per
environment, and arrays are NumPy's.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv  # pyright: ignore[reportMissingImports]

from taichi_plume.envs.picture import picture
from taichi_plume.envs.search import drawable, opened, spaces
from taichi_plume.envs.task import actions_of, open_episodes, put_by, seeds_of
from taichi_plume.scenario.scenario import Scenario


class SearchVecEnv(VecEnv):
    """`num_envs` environments of a scenario; keys as of `SearchEnv`.

    `infos` of an episode that ends: ``episode`` (r, l, t: its return, its decisions and its time [s]), ``search`` (how
    it went), ``terminal_observation`` and ``TimeLimit.truncated``.
    """

    def __init__(
        self,
        scenario: Scenario | dict[str, Any] | str | Path,
        num_envs: int = 1,
        render_mode: str | None = None,
        bank: Any = None,
        arch: str = "cpu",
        overrides: Sequence[str] = (),
        allow_outside: bool = False,
    ):
        self.render_mode = drawable(render_mode)
        given = {"bank": bank, "arch": arch, "overrides": overrides, "allow_outside": allow_outside}
        self.episodes: Any = open_episodes(scenario, num_envs, autoreset="same_step", **given)
        self.names = self.episodes.names
        self._random: np.random.Generator | None = None
        self._actions = np.empty(0, np.float32)
        self._lengths = np.zeros(num_envs, int)
        super().__init__(num_envs, *spaces(self.episodes))

    def reset(self) -> np.ndarray:
        """Begin episodes: of the seeds that `seed` has given, else the next ones."""
        anew = self._random is None or any(seed is not None for seed in self._seeds)
        self._random = self._random or np.random.default_rng()
        opened(self.episodes).reset(seeds_of(self._seeds, self.num_envs, self._random) if anew else None)
        self._lengths[:] = 0
        self._reset_seeds()
        self._reset_options()
        return self.episodes.observations.copy()

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions, (num_envs, actions), from -1 to 1."""
        self._actions = actions_of(actions)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """A decision of each. Raises ValueError where one is no number or out of range."""
        episodes = opened(self.episodes)
        episodes.step(self._actions)
        terminated, truncated = episodes.terminated.copy(), episodes.truncated.copy()
        over = terminated | truncated
        self._lengths += 1
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for e in np.flatnonzero(over):
            told = {name: float(values[e]) for name, values in episodes.info.items()}
            infos[e] = {
                "episode": {"r": told["return"], "l": int(self._lengths[e]), "t": told["time_s"]},
                "search": told,
                "terminal_observation": episodes.final_observations[e].copy(),
                "TimeLimit.truncated": bool(truncated[e] and not terminated[e]),
            }
        self._lengths[over] = 0
        return episodes.observations.copy(), episodes.rewards.copy(), over, infos

    def close(self) -> None:
        """Let go of everything."""
        put_by(self.episodes)
        self.episodes = None

    def get_images(self) -> list[np.ndarray | None]:
        """The worlds as they are, seen from above."""
        return [picture(opened(self.episodes), e) for e in range(self.num_envs)]

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute, the same one for all environments."""
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute, of all environments at once."""
        setattr(self, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """There are no environments of their own. Raises AttributeError."""
        raise AttributeError(f"{method_name}: the environments are one, and have no methods of their own")

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """They are wrapped in nothing."""
        return [False for _ in self._get_indices(indices)]
