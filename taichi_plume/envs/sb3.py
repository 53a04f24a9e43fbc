"""Vector environment for stable-baselines3, thousands of trials: ``SearchVecEnv("task.yaml", 512)`` is a VecEnv.

Unlike in a Gymnasium vector environment, an ended episode restarts in the same step, `infos` holds a dict per
environment, and arrays are NumPy arrays.
"""

from typing import Any, Unpack

import numpy as np
from stable_baselines3.common.vec_env import VecEnv  # pyright: ignore[reportMissingImports]

from taichi_plume.envs.picture import picture
from taichi_plume.envs.search import spaces
from taichi_plume.envs.task import Environment, Given, Options, actions_of, outcome, truth_of


class SearchVecEnv(VecEnv, Environment):
    """VecEnv of stable-baselines3 with `num_envs` environments of a scenario; options as for `SearchEnv`.

    With `team` each is a team of all robots of the group, and each robot counts as an environment of the VecEnv: the
    robots share one policy (parameter sharing), and their episodes end at once.

    `infos` of an ended episode: ``episode`` (r, l, t: return, decisions and time [s]), ``search`` (outcome of the
    episode, by the keys INFO of envs/step_kernel.py), ``terminal_observation`` and ``TimeLimit.truncated``. With
    `truth`, every info has ``truth``, and that of an ended episode ``terminal_truth``, the true state at its end.
    """

    def __init__(
        self,
        scenario: Given,
        num_envs: int = 1,
        render_mode: str | None = None,
        team: bool = False,
        **options: Unpack[Options],
    ):
        episodes = self._open(scenario, num_envs, None if team else 1, render_mode, "same_step", **options)
        self._random = np.random.default_rng()
        self._actions = np.empty(0, np.float32)
        self._lengths = np.zeros(num_envs, int)
        super().__init__(num_envs * episodes.robots, *spaces(episodes))

    def reset(self) -> np.ndarray:
        """Begin the first episodes of the seeds set by `seed`, else the next episodes; return the observations."""
        given = any(seed is not None for seed in self._seeds)
        self._begin(self._seeds[:: self.episodes.robots] if given else None, self._random)
        self._lengths[:] = 0
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = [truth_of(self.episodes.truth, e) for e in range(self.num_envs)]
        return self.episodes.observations.copy()

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions (num_envs, actions), from -1 to 1, for `step_wait`."""
        self._actions = actions_of(actions)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Advance all environments by one decision. Raises ValueError if an action is not a number or out of range."""
        episodes = self.episodes
        episodes.step(self._actions)
        terminated, truncated = episodes.terminated.copy(), episodes.truncated.copy()
        over, robots = terminated | truncated, episodes.robots
        self._lengths += 1
        infos: list[dict[str, Any]] = [truth_of(episodes.truth, i) for i in range(self.num_envs)]
        rows = np.flatnonzero(np.repeat(over, robots)).tolist()
        for i, e in ((i, i // robots) for i in rows):
            went = outcome(episodes, e)
            infos[i] |= {
                "episode": {"r": went["return"], "l": int(self._lengths[e]), "t": went["time_s"]},
                "search": went,
                "terminal_observation": episodes.final_observations[i].copy(),
                "TimeLimit.truncated": bool(truncated[e] and not terminated[e]),
                **{f"terminal_{key}": value for key, value in truth_of(episodes.final_truth, i).items()},
            }
        self._lengths[over] = 0
        return episodes.observations.copy(), episodes.rewards.copy(), np.repeat(over, robots), infos

    def close(self) -> None:
        """Close the environments and release their engine."""
        Environment.close(self)

    def get_images(self) -> list[np.ndarray | None]:
        """Return an image of each environment from above, (height, width, 3)."""
        return [picture(self.episodes, i // self.episodes.robots) for i in range(self.num_envs)]

    def get_attr(self, attr_name: str, indices: object = None) -> list[object]:
        """Return an attribute for each selected environment; the value is the same for all."""
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: object, indices: object = None) -> None:
        """Set an attribute of all environments at once."""
        setattr(self, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: object, indices: object = None, **method_kwargs: object
    ) -> list[object]:
        """Raise AttributeError: the environments share one object and have no methods of their own."""
        raise AttributeError(f"{method_name}: the environments share one object without such methods")

    def env_is_wrapped(self, wrapper_class: type, indices: object = None) -> list[bool]:
        """Return a list of False, one per selected environment, as environments here have no wrappers."""
        return [False for _ in self._get_indices(indices)]
