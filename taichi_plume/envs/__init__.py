"""Reinforcement-learning environments (Gymnasium, PettingZoo, SB3): thousands of trials at once in recorded airs.

``import taichi_plume.envs`` registers ``taichi_plume/Search-v0`` where Gymnasium is installed:
``gymnasium.make("taichi_plume/Search-v0", scenario="task.yaml")``, and ``gymnasium.make_vec`` for many at once.
"""

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Unpack

if TYPE_CHECKING:
    from pathlib import Path

    from taichi_plume.envs.sb3 import SearchVecEnv
    from taichi_plume.envs.task import Given, Options
    from taichi_plume.envs.team import TeamEnv

MAY_IMPORT: tuple[str, ...] = (
    "agents",
    "assembly",
    "engine",
    "files",
    "grid",
    "guard",
    "scenario",
    "time_loop",
    "solvers",
    "studies",
)

ID = "taichi_plume/Search-v0"


def register() -> None:
    """Register the environment `taichi_plume/Search-v0` with Gymnasium; a second call does nothing."""
    from gymnasium.envs.registration import register, registry

    if ID not in registry:
        register(
            ID,
            entry_point="taichi_plume.envs.search:SearchEnv",
            vector_entry_point="taichi_plume.envs.vector:SearchVectorEnv",
        )


def parallel_env(
    scenario: "Given", render_mode: str | None = None, **options: "Unpack[Options]"
) -> "TeamEnv":
    """Return an environment for PettingZoo (ParallelEnv) in which a team of robots learns, see `TeamEnv`.

    Raises ImportError with a one-line message if PettingZoo is missing, and ValueError.
    """
    _require("pettingzoo")
    from taichi_plume.envs.team import TeamEnv

    return TeamEnv(scenario, render_mode, **options)


def sb3_env(
    scenario: "Given",
    num_envs: int,
    render_mode: str | None = None,
    team: bool = False,
    **options: "Unpack[Options]",
) -> "SearchVecEnv":
    """Return an environment for stable-baselines3 (VecEnv) with `num_envs` trials at once, see `SearchVecEnv`.

    team: whether each trial has all robots of the group, which share the policy.

    Raises ImportError with a one-line message if stable-baselines3 is missing, and ValueError.
    """
    _require("stable_baselines3")
    from taichi_plume.envs.sb3 import SearchVecEnv

    return SearchVecEnv(scenario, num_envs, render_mode, team, **options)


def export_onnx(policy: Any, path: "Path | str", entries: int | None = None) -> "Path":
    """Write a trained policy to an ONNX file, which ``algorithm: {kind: policy, file: PATH}`` runs in any scenario.

    policy: a PPO or A2C model of stable-baselines3, or a torch.nn.Module from observations (batch, entries) to actions
    (batch, numbers), for which `entries` is needed. Actions are without exploration noise and clipped to -1 to 1.
    Returns the path. Raises ValueError, OSError, and ImportError with a one-line message if a package is missing.
    """
    from taichi_plume.envs.onnx_export import export_onnx

    return export_onnx(policy, path, entries)


def _require(package: str) -> None:
    """Raise ImportError if this package or Gymnasium is missing."""
    from taichi_plume.envs.task import require

    require(package)
    require("gymnasium")


if find_spec("gymnasium") is not None:
    register()
