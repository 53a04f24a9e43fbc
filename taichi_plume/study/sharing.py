"""Which airs can be solved once for many runs, and what of them is filmed; told without Taichi."""

import re
from collections.abc import Collection, Iterator, Mapping

from taichi_plume.scenario.scenario import Scenario

OF_ROBOTS = ("groups", "maps")  # what of a run's result tells nothing of the air itself
FILES_OF_ROBOTS = ("scenario.yaml", "robots.parquet", "maps.zarr")


def why_not(
    scenario: Scenario, outcomes: Mapping[str, str], share: str, keep: Collection[str] = ()
) -> str | None:
    """Why the air of a run cannot be solved apart from it and shown to it, in words; None where it can.

    outcomes, keep: what the study asks for besides trials. share: exact, where that has to give the same to the bit;
    always, also where gas of puffs is then known in the mean of its cells only; never.
    """
    return next(_reasons(scenario, outcomes, share, keep), None)


def _reasons(
    scenario: Scenario, outcomes: Mapping[str, str], share: str, keep: Collection[str]
) -> Iterator[str]:
    gases = filmed(scenario)[1]
    if share == "never":
        yield "share_air is never"
    if not scenario.robots:
        yield "there are no robots: the air is all that the run is for"
    if not scenario.wind.solved and not any(gas.solved for _, gas in scenario.gases):
        yield "neither wind nor gas is solved for: they cost nothing"
    for n, group in enumerate(scenario.robots):
        if group.wake:
            yield f"robots[{n}].wake: they stir the air"
    for name, path in outcomes.items():
        if re.split(r"[.\[]", path)[0] not in OF_ROBOTS:
            yield f"outcomes.{name}: {path} tells of the air itself"
    for name in keep:
        if name not in FILES_OF_ROBOTS:
            yield f"keep: {name} tells of the air itself"
    for path, gas in scenario.gases:
        if share == "exact" and path in gases and not gas.on_grid:
            yield f"{path}: gas of kind {gas.kind} is finer than what is filmed of it; share_air: always shares it"


def filmed(scenario: Scenario) -> tuple[bool, tuple[str, ...]]:
    """What of an air is filmed: whether the wind is, and the paths of which gases; the rest runs in each run itself.

    What a uniform wind carries in closed form needs that wind; all else may depend on the wind's own steps.
    """
    wind = scenario.wind.on_grid and scenario.wind.uniform is None
    return wind, tuple(path for path, gas in scenario.gases if wind or gas.solved)
