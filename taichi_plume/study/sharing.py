"""Which airs can be solved once for many runs, and what of them is filmed; told without Taichi."""

import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from taichi_plume.scenario.loading import scenario_of
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.study.messages import Request

if TYPE_CHECKING:
    from taichi_plume.study.plan import Plan

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


def shared_airs(plan: "Plan", requests: Sequence[Request]) -> set[str]:
    """The airs that several of the runs share and that can be solved apart from them.

    With share_air: always also those of single runs that are others in them, whatever else is still to be done.
    """
    study, counts = plan.study, Counter(one.air for one in requests)
    if study.share_air == "never":
        return set()
    always = study.share_air == "always"
    first = {
        (one.air, one.structure): one
        for one in (plan.requests if always else requests)
        if counts[one.air] > (0 if always else 1)
    }
    told: dict[str, list[bool]] = {}  # by structure, as numbers decide nothing of it: as wanted, and exactly
    airs: dict[str, list[list[bool]]] = {}
    for (air, structure), request in first.items():
        if structure not in told:
            scenario = scenario_of(plan.base, request.changes)
            ways = (study.share_air, "exact")
            told[structure] = [
                why_not(scenario, dict(study.outcomes), way, study.keep) is None for way in ways
            ]
        airs.setdefault(air, []).append(told[structure])
    return {
        air
        for air, its in airs.items()
        if all(wanted for wanted, _ in its) and (counts[air] > 1 or not all(exact for _, exact in its))
    }


def differs(scenario: Scenario, outcomes: Mapping[str, str], keep: Collection[str] = ()) -> bool:
    """Whether a run of a study with share_air: always is another one than where each run solves its own air."""
    exact, always = (why_not(scenario, outcomes, share, keep) for share in ("exact", "always"))
    return exact is not None and always is None


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
