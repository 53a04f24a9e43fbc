"""Scenarios as environments for learners: thousands of trials at once in recorded airs.

``import taichi_plume.envs`` registers ``taichi_plume/Search-v0`` where Gymnasium is installed:
``gymnasium.make("taichi_plume/Search-v0", scenario="task.yaml")``, and ``gymnasium.make_vec`` for many at once.
"""

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taichi_plume.envs.sb3 import SearchVecEnv
    from taichi_plume.envs.team import TeamEnv

MAY_IMPORT: tuple[str, ...] = (
    "agents",
    "assembly",
    "files",
    "grid",
    "guard",
    "scenario",
    "simulation",
    "solvers",
    "study",
)

ID = "taichi_plume/Search-v0"


def register() -> None:
    """Tell Gymnasium of the environments; once is enough."""
    from gymnasium.envs.registration import register, registry

    if ID not in registry:
        register(
            ID,
            entry_point="taichi_plume.envs.search:SearchEnv",
            vector_entry_point="taichi_plume.envs.vector:SearchVectorEnv",
        )


def parallel_env(scenario: Any, **keys: Any) -> "TeamEnv":
    """A team as PettingZoo's ParallelEnv; keys as of `TeamEnv`.

    Raises ImportError, in a line, where PettingZoo is missing, and ValueError.
    """
    from taichi_plume.envs.task import require

    require("pettingzoo")
    require("gymnasium")
    from taichi_plume.envs.team import TeamEnv

    return TeamEnv(scenario, **keys)


def sb3_env(scenario: Any, num_envs: int, **keys: Any) -> "SearchVecEnv":
    """Many trials at once as stable-baselines3's VecEnv; keys as of `SearchVecEnv`.

    Raises ImportError, in a line, where stable-baselines3 is missing, and ValueError.
    """
    from taichi_plume.envs.task import require

    require("stable_baselines3")
    require("gymnasium")
    from taichi_plume.envs.sb3 import SearchVecEnv

    return SearchVecEnv(scenario, num_envs, **keys)


if find_spec("gymnasium") is not None:
    register()
