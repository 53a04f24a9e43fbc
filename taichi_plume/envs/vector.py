"""Thousands of trials at once, as Gymnasium has it: ``gymnasium.make_vec("taichi_plume/Search-v0", 4096, ...)``."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from taichi_plume.envs.picture import picture
from taichi_plume.envs.search import RENDER_FPS, drawable, opened, spaces
from taichi_plume.envs.task import actions_of, open_episodes, options_of, put_by, seeds_of
from taichi_plume.guard.terminal import visible
from taichi_plume.scenario.scenario import Scenario


class SearchVectorEnv(VectorEnv[Any, Any, Any]):
    """`num_envs` environments in one process; see `SearchEnv` for what one is, and for the keys.

    autoreset_mode: of Gymnasium. arrays: "torch" gives and takes tensors on Taichi's device. Observations are the
    engine's own arrays: the last ones stay valid for a step; with `copy` they are yours. Of the episodes that end in a
    step, `info` tells how they went, in an array per key, and by `_key` which environments it is of.
    """

    def __init__(
        self,
        scenario: Scenario | dict[str, Any] | str | Path,
        num_envs: int = 1,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        arrays: str = "numpy",
        copy: bool = False,
        render_mode: str | None = None,
        bank: Any = None,
        arch: str = "cpu",
        overrides: Sequence[str] = (),
        allow_outside: bool = False,
    ):
        self.render_mode = drawable(render_mode)
        self.autoreset_mode = mode = mode_of(autoreset_mode)
        given = {"bank": bank, "arch": arch, "overrides": overrides, "allow_outside": allow_outside}
        self.episodes: Any = open_episodes(
            scenario, num_envs, autoreset=mode.name.lower(), arrays=arrays, **given
        )
        self.num_envs, self.copy, self.arrays = num_envs, copy, arrays
        self.names = self.episodes.names
        self.metadata = {
            "autoreset_mode": mode,
            "render_modes": ["rgb_array"],
            "render_fps": RENDER_FPS,
            "torch": arrays == "torch",
        }
        self.single_observation_space, self.single_action_space = spaces(self.episodes)
        self.observation_space: gymnasium.Space[Any] = batch_space(self.single_observation_space, num_envs)
        self.action_space: gymnasium.Space[Any] = batch_space(self.single_action_space, num_envs)
        self._seeded = False

    def reset(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin episodes, of environment k with seed + k; options: ``reset_mask`` (num_envs,) tells which ones."""
        one = seed if isinstance(seed, int | np.integer) else None
        super().reset(seed=None if one is None else int(one) % 2**63)
        episodes = opened(self.episodes)
        mask = options_of(options).get("reset_mask")
        if mask is not None:
            mask = masked(mask, self.num_envs)
        anew = seed is not None or not self._seeded
        episodes.reset(seeds_of(seed, self.num_envs, self.np_random) if anew else None, mask)
        self._seeded = True
        return self._own(episodes.observations), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """A decision of each, (num_envs, actions). Raises ValueError where one is no number or out of range."""
        episodes = opened(self.episodes)
        episodes.step(actions if self.arrays == "torch" else actions_of(actions))
        terminated, truncated = self._kept(episodes.terminated), self._kept(episodes.truncated)
        over = terminated | truncated
        info = self._info(over) if over.any() else {}
        return self._own(episodes.observations), self._kept(episodes.rewards), terminated, truncated, info

    def render(self) -> tuple[np.ndarray, ...] | None:
        """The worlds as they are, seen from above; None where no render mode was given."""
        if not self.render_mode:
            return None
        return tuple(picture(opened(self.episodes), e) for e in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Let go of everything."""
        put_by(self.episodes)
        self.episodes = None

    def _info(self, over: Any) -> dict[str, Any]:
        """How the episodes went that are over."""
        told: dict[str, Any] = {}
        for name, values in self.episodes.info.items():
            told[name], told[f"_{name}"] = self._kept(values), over
        if self.autoreset_mode != AutoresetMode.SAME_STEP:
            return told
        final = self._kept(self.episodes.final_observations)
        return {"final_obs": final, "_final_obs": over, "final_info": told, "_final_info": over}

    def _own(self, observations: Any) -> Any:
        return self._kept(observations) if self.copy else observations

    def _kept(self, values: Any) -> Any:
        return values.clone() if self.arrays == "torch" else values.copy()


def mode_of(name: str | AutoresetMode) -> AutoresetMode:
    """The autoreset mode of a name, such as next_step or NextStep. Raises ValueError."""
    for mode in AutoresetMode:
        if name in (mode, mode.value, mode.name, mode.name.lower()):
            return mode
    allowed = ", ".join(mode.name.lower() for mode in AutoresetMode)
    raise ValueError(f"autoreset_mode: got '{visible(name)}', allowed are {allowed}")


def masked(mask: Any, count: int) -> np.ndarray:
    """A mask of environments. Raises ValueError."""
    try:
        mask = np.asarray(mask)
    except ValueError:  # of rows that differ in length
        mask = np.empty(0)
    if mask.shape != (count,) or mask.dtype != np.bool_ or not mask.any():
        raise ValueError(f"reset_mask: wanted {count} truth values, of which one is true at least")
    return mask
