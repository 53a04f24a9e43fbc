"""Reinforcement-learning tasks: checks of the scenario, and the base class of all environments."""

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from operator import index
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np

from taichi_plume.envs.picture import picture
from taichi_plume.guard.terminal import visible
from taichi_plume.scenario.loading import Overrides, ScenarioError, scenario_from
from taichi_plume.scenario.own_code import OwnLaw
from taichi_plume.scenario.scenario import Scenario

if TYPE_CHECKING:
    from taichi_plume.envs.bank import Bank
    from taichi_plume.envs.episodes import Array, Episodes, Rewarder

EXTRA = 'pip install "taichi_plume[learn]"'
RENDER_FPS = 10
MOST_BANKS = 2  # largest number of banks that this process caches for further environments
MOST = 1_000_000  # largest number of environments, so that indices of observations fit into 32 bits

Given = Scenario | dict[str, object] | str | Path
"""Scenario in any form that users may give: object, dict or path of a file."""

_banks: "OrderedDict[str, Bank]" = OrderedDict()


class Options(TypedDict, total=False):
    """Options of every environment.

    bank: recorded flow realisations (airs) or their path; recorded now unless given. arch: backend, unless Taichi runs.
    overrides: of a scenario file, as texts or a dict. allow_outside: whether files may lie outside its folder.
    truth: add the true state of the robots to `info`, by the key "truth", see `Truth` in envs/truth.py. reward:
    function that takes a `Transition` (envs/episodes.py) of all environments and returns the reward of each robot.
    """

    truth: bool
    reward: "Rewarder | None"
    bank: "Bank | str | Path | None"
    arch: str
    overrides: Overrides
    allow_outside: bool


def open_task(
    scenario: Given, overrides: Overrides = (), allow_outside: bool = False
) -> tuple[Scenario, Path]:
    """Return the checked scenario of a task and the folder of its files; for a dict or Scenario the current folder.

    overrides: changes to a file, such as ``task.airs=8``. Raises ValueError (ScenarioError), a line for each fault.
    """
    from taichi_plume.assembly.preparation import checked, load

    if isinstance(overrides, str):
        raise ValueError(f"overrides: got a text; give a list of texts, ['{visible(overrides)}']")
    if not isinstance(overrides, Sequence | Mapping) or not all(isinstance(text, str) for text in overrides):
        raise ValueError(
            "overrides: must be a list of texts, such as ['task.airs=8'], or a dict, {'task.airs': 8}"
        )
    if isinstance(scenario, str | Path):
        path = Path(scenario)
        checked_scenario, folder = load(path, overrides, allow_outside).scenario, path.resolve().parent
    elif overrides:
        raise ValueError("overrides: apply only to a scenario file; change the dict or Scenario itself")
    elif isinstance(scenario, dict | Scenario):
        folder = Path.cwd()
        given = scenario if isinstance(scenario, Scenario) else scenario_from(scenario)
        checked_scenario = checked(given, folder, allow_outside).scenario
    else:
        kind = type(scenario).__name__
        raise ValueError(f"scenario: got {visible(kind)}; give the path of a YAML file, a dict or a Scenario")
    require_task(checked_scenario)
    return checked_scenario, folder


def require_task(scenario: Scenario) -> None:
    """Raise ScenarioError if a task has no learners, no possible success, or parts that are unsupported."""
    if not scenario.robots:
        raise ScenarioError(["robots: there are none; add a group of learners"])
    group = scenario.learners
    name = visible(group.name)
    if group.found == "declared" and not group.algorithm.may_declare:
        what = "never declares, so no search can succeed; give algorithm: {kind: policy, declares: true}"
        raise ScenarioError([f"robots: group '{name}' has found: declared, but its policy {what}"])
    if group.sensors.range is not None:
        raise ScenarioError([f"robots: sensors.range of '{name}': environments do not support range sensors"])
    if group.sensors.classifier is not None:
        raise ScenarioError(
            [f"robots: sensors.classifier of '{name}': environments do not support classifiers"]
        )
    for path, sensor in group.sensors.placed():
        if sensor.kind == "tdlas":
            raise ScenarioError([f"robots: {path}.kind of '{name}': environments do not support tdlas"])
    sections: list[tuple[str, Any]] = [("wind", scenario.wind), *scenario.gases]
    for path, section in sections:
        if getattr(section, "fluctuations", False):
            raise ScenarioError(
                [f"{path}.fluctuations: environments do not support them; give fluctuations: false"]
            )
        if isinstance(section, OwnLaw):
            raise ScenarioError(
                [f"{path}.kind: own: environments do not support it; record a film, and play it back"]
            )
    for n, obstacle in enumerate(scenario.obstacles):
        if obstacle.motion:
            raise ScenarioError([f"obstacles[{n}]: moves; environments support only fixed obstacles"])
    for path, source in scenario.sources:
        if vars(source).get("motion"):
            raise ScenarioError([f"{path}.motion: environments support only sources that stay in place"])
    require_parted(scenario)


def require_parted(scenario: Scenario) -> None:
    """Raise ScenarioError if episodes need a single gas, but all gases together drive the air's buoyancy."""
    heavy = scenario.buoyancy is not None and scenario.buoyancy.solutal
    if scenario.task.sources == "one" and heavy and len(scenario.gases) > 1:
        why = "all gases change the density of the air, so no film holds a single gas"
        raise ScenarioError([f"task.sources: one: {why}; use sources: all, or a single gas"])


def open_episodes(
    scenario: Given,
    count: int,
    robots: int | None = 1,
    autoreset: str = "next_step",
    arrays: str = "numpy",
    **options: Unpack[Options],
) -> "Episodes":
    """Return the engine of `count` environments with `robots` robots each; None: as many as the group has.

    autoreset, arrays: see `Episodes`. A bank that is recorded now is cached for further environments of this process.
    Raises ValueError.
    """
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
        raise ValueError(f"num_envs: got {visible(count)}, must be a whole number from 1 on")
    if count > MOST:
        raise ValueError(f"num_envs: got {count:,}, at most {MOST:,} are possible")
    if unknown := options.keys() - Options.__annotations__.keys():
        raise TypeError(f"got an unexpected keyword argument '{min(unknown)}'")
    if arrays == "torch":
        require("torch")
    truth, reward = options.get("truth", False), options.get("reward")
    if not isinstance(truth, bool):
        raise ValueError(f"truth: got {visible(truth)}, must be True or False")
    if reward is not None and not callable(reward):
        raise ValueError(f"reward: got {visible(reward)}, must be a function of a step, or None")
    outside = options.get("allow_outside", False)
    checked_scenario, folder = open_task(scenario, options.get("overrides", ()), outside)
    _start(options.get("arch", "cpu"))
    from taichi_plume.envs.bank import bank_of, key_of
    from taichi_plume.envs.episodes import Episodes

    given = options.get("bank")
    if given is None:
        key = key_of(checked_scenario, folder)
        if key not in _banks:
            _banks[key] = bank_of(checked_scenario, folder, allow_outside=outside)
            while len(_banks) > MOST_BANKS:
                _banks.popitem(last=False)
        bank = _banks[key]
    else:
        bank = bank_of(checked_scenario, folder, given)
    team = checked_scenario.learners.count if robots is None else robots
    episodes = Episodes(checked_scenario, folder, int(count), team, bank, autoreset, arrays)
    episodes.shows_truth, episodes.rewarder = truth, reward
    return episodes


def _start(arch: str) -> None:
    """Start Taichi on `arch` unless it runs: a second start would destroy the fields of existing environments."""
    from taichi_plume.engine import program

    if not program.is_running():
        try:
            program.start(arch)
        except RuntimeError as error:
            raise ValueError(f"arch: {error}") from None


class Environment:
    """Base class of all learning environments: engine, seeds, rendering and closing.

    names: of the entries of an observation; action_names: of the numbers of an action.
    """

    render_mode: str | None
    _episodes: "Episodes | None" = None
    _seeded = False

    def _open(
        self,
        scenario: Given,
        count: int,
        robots: int | None,
        render_mode: str | None,
        autoreset: str,
        arrays: str = "numpy",
        **options: Unpack[Options],
    ) -> "Episodes":
        """Open the engine with `count` environments of the scenario and return it. Raises ValueError."""
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode: got '{render_mode}', allowed are None and 'rgb_array'")
        self.render_mode = render_mode
        self._episodes = open_episodes(scenario, count, robots, autoreset, arrays, **options)
        self.names, self.action_names = self._episodes.names, self._episodes.action_names
        return self._episodes

    @property
    def episodes(self) -> "Episodes":
        """The engine of the environment. Raises ValueError once the environment is closed."""
        if self._episodes is None:
            raise ValueError("the environment is closed; make another environment")
        return self._episodes

    def _begin(self, seed: object, random: np.random.Generator, mask: np.ndarray | None = None) -> None:
        """Begin the first episodes of `seed` or, without a seed, the next episodes; mask: environments that begin."""
        episodes = self.episodes
        restarts = seed is not None or not self._seeded
        episodes.reset(seeds_of(seed, episodes.count, random) if restarts else None, mask)
        self._seeded = True

    def render(self) -> np.ndarray | None:
        """Return an image of the first environment from above, (height, width, 3); None without a render mode."""
        return picture(self.episodes, 0) if self.render_mode else None

    def close(self) -> None:
        """Close the environment and free its memory."""
        self._episodes = None


def seeds_of(seed: object, count: int, random: np.random.Generator) -> np.ndarray:
    """Return a seed per environment: seed, seed + 1, ... for a number, or those of a list; None becomes random.

    Raises ValueError.
    """
    if isinstance(seed, np.ndarray) and not seed.ndim:
        seed = seed.item()
    several: list[int | None]
    if isinstance(seed, Sequence | np.ndarray) and not isinstance(seed, str | bytes):
        several = [None if each is None else _whole(each) for each in seed]
    else:
        several = [None] * count if seed is None else [_whole(seed) + k for k in range(count)]
    if len(several) != count:
        raise ValueError(
            f"seed: got {len(several)} seeds, must be a number or one for each of {count} environments"
        )
    if any(each is not None and not 0 <= each < 2**64 for each in several):
        raise ValueError("seed: got a seed that is negative or has more than 64 bits")
    drawn = random.integers(0, 2**63, count, dtype=np.uint64)
    pairs = zip(several, drawn, strict=True)
    return np.array([chance if each is None else np.uint64(each) for each, chance in pairs], np.uint64)


def _whole(seed: object) -> int:
    try:
        return index(seed)  # type: ignore[arg-type]
    except TypeError:
        raise ValueError(f"seed: got {visible(repr(seed), 60)}, must be a whole number") from None


def actions_of(given: object) -> np.ndarray:
    """Return a user's actions as an f32 array. Raises ValueError if they are not numbers."""
    try:
        numbers = np.asarray(given)
        if numbers.dtype.kind not in "fiubO":
            raise TypeError(f"got {numbers.dtype}")
        return numbers.astype(np.float32, copy=False)
    except (TypeError, ValueError, RuntimeError) as error:
        raise ValueError(f"actions: must be an array of numbers: {visible(error, 200)}") from None


def options_of(given: object) -> Mapping[str, object]:
    """Return the options of a reset as a mapping. Raises ValueError if they are not a dict or None."""
    if given is not None and not isinstance(given, dict):
        raise ValueError(f"options: got {visible(type(given).__name__)}, must be a dict or None")
    return given or {}


def truth_of(truth: "Mapping[str, Array]", robot: int) -> dict[str, object]:
    """Return {"truth": ...} with the true state of one robot, see `Truth`; {} without `truth`."""
    if not truth:
        return {}
    return {
        "truth": {
            key: values[robot] if values.ndim == 1 else values[robot].copy() for key, values in truth.items()
        }
    }


def outcome(episodes: "Episodes", e: int) -> dict[str, float]:
    """Return the outcome (INFO in envs/step_kernel.py) of environment e's last episode, by name."""
    return {name: float(values[e]) for name, values in episodes.info.items()}


def require(package: str) -> None:
    """Raise ImportError, with the pip command that installs it, if a package is missing."""
    from importlib.util import find_spec

    if find_spec(package) is None:
        raise ImportError(f"{package} is not installed; {EXTRA}", name=package)
