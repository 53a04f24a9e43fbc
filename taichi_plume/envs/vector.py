"""Vector environment for Gymnasium with many trials: ``gymnasium.make_vec("taichi_plume/Search-v0", 4096, ...)``."""

from collections.abc import Sequence
from typing import Any, Unpack

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from taichi_plume.envs.episodes import Array
from taichi_plume.envs.picture import picture
from taichi_plume.envs.search import spaces
from taichi_plume.envs.task import RENDER_FPS, Environment, Given, Options, actions_of, options_of
from taichi_plume.guard.terminal import visible


class SearchVectorEnv(VectorEnv[Any, Any, Any], Environment):
    """Gymnasium vector environment: `num_envs` environments in one process, each as `SearchEnv`.

    autoreset_mode: of Gymnasium. arrays: "torch" for tensors on Taichi's device. Observations are the engine's own
    arrays, valid for one further step, or copies if `copy`. `info` holds the outcomes of the episodes that end in a
    step: an array per key, and by `_key` a mask of the environments. The keys are INFO of envs/step_kernel.py; with
    `truth`, every `info` also has "truth", the true state of all robots as arrays by key.
    """

    def __init__(
        self,
        scenario: Given,
        num_envs: int = 1,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        arrays: str = "numpy",
        copy: bool = False,
        render_mode: str | None = None,
        **options: Unpack[Options],
    ):
        self.autoreset_mode = mode = mode_of(autoreset_mode)
        episodes = self._open(scenario, num_envs, 1, render_mode, mode.name.lower(), arrays, **options)
        self.num_envs, self.copy, self.arrays = num_envs, copy, arrays
        self.metadata = {
            "autoreset_mode": mode,
            "render_modes": ["rgb_array"],
            "render_fps": RENDER_FPS,
            "torch": arrays == "torch",
        }
        self.single_observation_space, self.single_action_space = spaces(episodes)
        self.observation_space: gymnasium.Space[Any] = batch_space(self.single_observation_space, num_envs)
        self.action_space: gymnasium.Space[Any] = batch_space(self.single_action_space, num_envs)

    def reset(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, object] | None = None
    ) -> tuple[Array, dict[str, object]]:
        """Begin episodes, with seed + k in environment k; options: ``reset_mask`` (num_envs,) selects environments."""
        super().reset(seed=int(seed) % 2**63 if isinstance(seed, int | np.integer) else None)
        episodes = self.episodes
        mask = options_of(options).get("reset_mask")
        self._begin(seed, self.np_random, None if mask is None else masked(mask, self.num_envs))
        return self._own(episodes.observations), self._truth(episodes.truth)

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, object]]:
        """Advance by one decision, actions (num_envs, n). Raises ValueError if an action is invalid or out of range."""
        episodes = self.episodes
        episodes.step(actions if self.arrays == "torch" else actions_of(actions))
        terminated, truncated = self._copied(episodes.terminated), self._copied(episodes.truncated)
        over = terminated | truncated
        info = {**(self._info(over) if over.any() else {}), **self._truth(episodes.truth)}
        return self._own(episodes.observations), self._copied(episodes.rewards), terminated, truncated, info

    def render(self) -> tuple[np.ndarray, ...] | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return an image of each environment from above; None without a render mode."""
        if not self.render_mode:
            return None
        return tuple(picture(self.episodes, e) for e in range(self.num_envs))

    def close_extras(self, **kwargs: object) -> None:
        """Release the engine; called by `VectorEnv.close`."""
        Environment.close(self)

    def _info(self, over: Array) -> dict[str, object]:
        """Return the outcomes of the episodes that have ended in this step, in Gymnasium's form; over: their mask."""
        info: dict[str, object] = {}
        for name, values in self.episodes.info.items():
            info[name], info[f"_{name}"] = self._copied(values), over
        if self.autoreset_mode != AutoresetMode.SAME_STEP:
            return info
        info |= self._truth(self.episodes.final_truth, over)
        final = self._copied(self.episodes.final_observations)
        return {"final_obs": final, "_final_obs": over, "final_info": info, "_final_info": over}

    def _truth(self, truth: "dict[str, Array]", mask: Array | None = None) -> dict[str, object]:
        """Return {"truth": ..., "_truth": mask} with the robots' true state, by default of all; {} without `truth`."""
        if not truth:
            return {}
        every = np.ones(self.num_envs, bool) if mask is None else mask
        return {"truth": dict(truth), "_truth": every}

    def _own(self, observations: Array) -> Array:
        return self._copied(observations) if self.copy else observations

    def _copied(self, values: Array) -> Array:
        return values.clone() if self.arrays == "torch" else values.copy()


def mode_of(name: str | AutoresetMode) -> AutoresetMode:
    """Return Gymnasium's autoreset mode for a name, such as next_step or NextStep. Raises ValueError."""
    for mode in AutoresetMode:
        if name in (mode, mode.value, mode.name, mode.name.lower()):
            return mode
    allowed = ", ".join(mode.name.lower() for mode in AutoresetMode)
    raise ValueError(f"autoreset_mode: got '{visible(name)}', allowed are {allowed}")


def masked(given: object, count: int) -> np.ndarray:
    """Return a user's reset mask as a boolean array (count,). Raises ValueError unless a value is true."""
    try:
        mask = np.asarray(given)
    except ValueError:  # rows that differ in length
        mask = np.empty(0)
    if mask.shape != (count,) or mask.dtype != np.bool_ or not mask.any():
        raise ValueError(f"reset_mask: must be {count} truth values, at least one of which is true")
    return mask
