"""Decide which flow and gas fields (airs) are solved once for several runs, and what their films hold. No Taichi."""

import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from taichi_plume.scenario.loading import scenario_of
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.studies.messages import Request

if TYPE_CHECKING:
    from taichi_plume.studies.plan import Plan

OF_ROBOTS = ("groups", "maps")  # sections of a result that do not depend on how the air is represented
FILES_OF_ROBOTS = ("scenario.yaml", "robots.parquet", "maps.zarr")


def why_not(
    scenario: Scenario, outcomes: Mapping[str, str], share: str, keep: Collection[str] = ()
) -> str | None:
    """Return the reason why a run cannot play recorded wind and gas (a film); None if the run can.

    outcomes, keep: requested outcomes and files. share: exact, if results must be equal to the bit; always, also if the
    film holds only cell means of puffs; never.
    """
    return next(_reasons(scenario, outcomes, share, keep), None)


def shared_airs(plan: "Plan", requests: Sequence[Request]) -> set[str]:
    """Return the airs to film: those that several of the runs share and that can be filmed.

    With share_air: always, also the airs of single runs whose results a film changes, so that all runs use films. If
    the study keeps files, which state whether a film was played, the runs of the whole plan count.
    """
    study = plan.study
    counts = Counter(request.air for request in (plan.requests if study.keep else requests))
    if study.share_air == "never":
        return set()
    always = study.share_air == "always"
    structures: dict[str, set[str]] = {}  # by air
    runs: dict[str, Request] = {}  # by structure; one decides for all
    for request in plan.requests if always else requests:
        if counts[request.air] > (0 if always else 1):
            structures.setdefault(request.air, set()).add(request.structure)
            runs.setdefault(request.structure, request)
    scenarios = {structure: scenario_of(plan.base, run.changes) for structure, run in runs.items()}
    sharable, exact = (
        {name for name, each in scenarios.items() if why_not(each, study.outcomes, way, study.keep) is None}
        for way in (study.share_air, "exact")
    )
    return {
        air
        for air, of_air in structures.items()
        if of_air <= sharable and (counts[air] > 1 or not of_air <= exact)
    }


def differs(scenario: Scenario, outcomes: Mapping[str, str], keep: Collection[str] = ()) -> bool:
    """Return whether playback of recorded wind and gas is possible but changes a run's results."""
    exact, always = (why_not(scenario, outcomes, share, keep) for share in ("exact", "always"))
    return exact is not None and always is None


def _reasons(
    scenario: Scenario, outcomes: Mapping[str, str], share: str, keep: Collection[str]
) -> Iterator[str]:
    gases = filmed(scenario)[1]
    if share == "never":
        yield "share_air is never"
    if not scenario.robots:
        yield "there are no robots: the run only computes the air"
    if not scenario.wind.solved and not any(gas.solved for _, gas in scenario.gases):
        yield "neither wind nor gas is solved numerically, so a film saves nothing"
    for n, group in enumerate(scenario.robots):
        if group.wake:
            yield f"robots[{n}].wake: these robots stir the air"
    for name, path in outcomes.items():
        if re.split(r"[.\[]", path)[0] not in OF_ROBOTS:
            yield f"outcomes.{name}: {path} is a quantity of the air itself"
    for name in keep:
        if name not in FILES_OF_ROBOTS:
            yield f"keep: {name} holds data of the air itself"
    for path, gas in scenario.gases:
        if share == "exact" and path in gases and not gas.on_grid:
            yield f"{path}: gas of kind {gas.kind} is finer than the film; share_air: always shares it anyway"


def filmed(scenario: Scenario) -> tuple[bool, tuple[str, ...]]:
    """Return whether the wind is filmed, and the paths of the filmed gases. Each run computes the rest itself.

    A uniform wind is not filmed, as gas in closed form needs it. All gas in a filmed wind is filmed.
    """
    wind = scenario.wind.on_grid and scenario.wind.uniform is None
    return wind, tuple(path for path, gas in scenario.gases if wind or gas.solved)
