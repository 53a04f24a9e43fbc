"""A scenario as a task: what the faces of the engine have in common, whoever asks."""

from collections import OrderedDict
from collections.abc import Sequence
from operator import index
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_plume.guard.terminal import visible
from taichi_plume.scenario.loading import ScenarioError, scenario_from
from taichi_plume.scenario.scenario import Scenario

if TYPE_CHECKING:
    from taichi_plume.envs.bank import Bank
    from taichi_plume.envs.episodes import Episodes

EXTRA = 'pip install "taichi_plume[learn]"'
KEPT = 2  # banks that this process keeps for environments to come
MOST = 1_000_000  # environments: their arrays of observations stay countable in 32 bits
IDLE = 4  # engines that it keeps of environments that were closed: to make one compiles for seconds

_banks: "OrderedDict[str, Bank]" = OrderedDict()
_idle: "OrderedDict[str, Episodes]" = OrderedDict()


def open_task(
    scenario: Scenario | dict[str, Any] | str | Path,
    overrides: Sequence[str] = (),
    allow_outside: bool = False,
) -> tuple[Scenario, Path]:
    """A checked scenario and the folder of its files: the current one where it is not read from a file.

    overrides: such as ``task.airs=8``, of a file. Raises ValueError (ScenarioError), a line for each fault.
    """
    from taichi_plume.assembly.prepare import checked, load

    if isinstance(overrides, str):
        raise ValueError(f"overrides: got one text; give a list of them, ['{visible(overrides)}']")
    if not isinstance(overrides, Sequence) or not all(isinstance(one, str) for one in overrides):
        raise ValueError("overrides: wanted a list of texts, such as ['task.airs=8']")
    if isinstance(scenario, str | Path):
        path = Path(scenario)
        found, folder = load(path, overrides, allow_outside).scenario, path.resolve().parent
    elif overrides:
        raise ValueError("overrides: are for a scenario that is a file; change the scenario itself")
    elif isinstance(scenario, dict | Scenario):
        folder = Path.cwd()
        given = scenario if isinstance(scenario, Scenario) else scenario_from(scenario)
        found = checked(given, folder, allow_outside).scenario
    else:
        kind = type(scenario).__name__
        raise ValueError(f"scenario: got {visible(kind)}; give the path of a YAML file, a dict or a Scenario")
    require_task(found)
    return found, folder


def require_task(scenario: Scenario) -> None:
    """Raises ScenarioError, in a line, where nobody learns or could find anything, or where obstacles move."""
    if not scenario.robots:
        raise ScenarioError(["robots: there are none, and nobody learns; give a group"])
    group = scenario.learners
    if group.found == "declared" and not group.algorithm.may_declare:
        what = "never declares, nothing would count as found; give algorithm: {kind: policy, declares: true}"
        raise ScenarioError(
            [f"robots: group '{visible(group.name)}' has found: declared, but its policy {what}"]
        )
    if group.body.flies:
        what = f"has the body of a {group.body.kind}, which flies; environments have robots of the floor"
        raise ScenarioError([f"robots: group '{visible(group.name)}' {what}"])
    for path, sensor in group.sensors.placed():
        if sensor.kind == "tdlas":
            raise ScenarioError(
                [f"robots: {path}.kind of '{visible(group.name)}': environments know no tdlas"]
            )
    for n, obstacle in enumerate(scenario.obstacles):
        if obstacle.motion:
            raise ScenarioError([f"obstacles[{n}]: moves; environments have obstacles that stand"])
    require_parted(scenario)


def require_parted(scenario: Scenario) -> None:
    """Raises ScenarioError where single gases cannot be taken out of an air that all move."""
    heavy = scenario.buoyancy is not None and scenario.buoyancy.solutal
    if scenario.task.sources == "one" and heavy and len(scenario.gases) > 1:
        raise ScenarioError(
            [
                "task.sources: one: the gases make the air heavier, so that none is alone in what is recorded; use "
                "sources: all, or a single gas"
            ]
        )


def open_episodes(
    scenario: Scenario | dict[str, Any] | str | Path,
    count: int,
    robots: int | None = 1,
    bank: Any = None,
    arch: str = "cpu",
    overrides: Sequence[str] = (),
    allow_outside: bool = False,
    **engine: Any,
) -> "Episodes":
    """The engine of `count` environments; robots: of each, unless given as many as the group has.

    bank: the recorded airs or where they lie; recorded now unless given, and kept for the next environments of this
    process. arch: where to compute, unless Taichi runs already. engine: options of `Episodes`. Raises ValueError.
    """
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
        raise ValueError(f"num_envs: got {visible(count)}, wanted a whole number from 1 on")
    if count > MOST:
        raise ValueError(f"num_envs: got {count:,}, at most {MOST:,} are together")
    if engine.get("arrays") == "torch":
        require("torch")
    found, folder = open_task(scenario, overrides, allow_outside)
    _start(arch)
    from taichi_plume.envs.bank import bank_of, key_of
    from taichi_plume.envs.episodes import Episodes

    if bank is None:
        key = key_of(found, folder)
        if key not in _banks:
            _banks[key] = bank_of(found, folder, allow_outside=allow_outside)
            while len(_banks) > KEPT:
                _banks.popitem(last=False)
        bank = _banks[key]
    else:
        bank = bank_of(found, folder, bank)
    team = found.learners.count if robots is None else robots
    told = repr((found, folder, int(count), team, bank.key, sorted(engine.items())))
    episodes = _idle.pop(told, None)
    if episodes is not None and episodes.runs_in is _runtime():
        episodes.begin()
        return episodes
    episodes = Episodes(found, folder, int(count), team, bank=bank, **engine)
    episodes.told, episodes.runs_in = told, _runtime()
    return episodes


def put_by(episodes: "Episodes | None") -> None:
    """Keep the engine of an environment that was closed, for another one of the same task."""
    if episodes is not None:
        _idle[episodes.told] = episodes
        while len(_idle) > IDLE:
            _idle.popitem(last=False)


def _runtime() -> Any:
    """The runtime of Taichi, whose fields an engine has; None where it does not run."""
    from taichi.lang import impl

    return impl.get_runtime().prog


def _start(arch: str) -> None:
    """Start Taichi where it does not run: a second start would take the fields of those before."""
    from taichi_plume.grid import kernels

    if _runtime() is None:
        try:
            kernels.start(arch)
        except RuntimeError as error:
            raise ValueError(f"arch: {error}") from None


def seeds_of(seed: Any, count: int, random: np.random.Generator) -> np.ndarray:
    """Of each environment: seed, seed + 1, ... of a number, those of a list, and by chance where there is none.

    Raises ValueError.
    """
    several: list[Any]
    if isinstance(seed, np.ndarray) and not seed.ndim:
        seed = seed.item()
    if isinstance(seed, Sequence | np.ndarray) and not isinstance(seed, str | bytes):
        several = [None if one is None else _whole(one) for one in seed]
    else:
        several = [None] * count if seed is None else [_whole(seed) + k for k in range(count)]
    if len(several) != count:
        raise ValueError(
            f"seed: got {len(several)} seeds for {count} environments; give one each, or a number"
        )
    drawn = random.integers(0, 2**63, count, dtype=np.uint64)
    if any(one is not None and not 0 <= one < 2**64 for one in several):
        raise ValueError("seed: got one that is negative or has more than 64 bits")
    return np.array(
        [d if one is None else np.uint64(one) for one, d in zip(several, drawn, strict=True)], np.uint64
    )


def _whole(seed: Any) -> int:
    try:
        return index(seed)
    except TypeError:
        raise ValueError(f"seed: got {visible(repr(seed), 60)}, wanted a whole number") from None


def actions_of(given: Any) -> np.ndarray:
    """Actions as numbers, f32. Raises ValueError, in a line, where they are none."""
    try:
        numbers = np.asarray(given)
        if numbers.dtype.kind not in "fiubO":
            raise TypeError(f"got {numbers.dtype}")
        return numbers.astype(np.float32, copy=False)
    except (TypeError, ValueError, RuntimeError) as error:
        raise ValueError(f"actions: wanted an array of numbers: {visible(error, 200)}") from None


def options_of(given: Any) -> dict[str, Any]:
    """Options of a reset. Raises ValueError where they are no dict."""
    if given is not None and not isinstance(given, dict):
        raise ValueError(f"options: got {visible(type(given).__name__)}, wanted a dict or None")
    return given or {}


def require(package: str) -> None:
    """Raises ImportError, in a line that names the extra, where a package of it is missing."""
    from importlib.util import find_spec

    if find_spec(package) is None:
        raise ImportError(f"{package} is not installed; {EXTRA}", name=package)
