"""Judging of declarations: the outcome of each trial and the localisation error of the declared source position."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_plume.scenario.robots import Group

if TYPE_CHECKING:
    from taichi_plume.agents.groups import GroupRange

Json = dict[str, Any]
"""JSON object, as in result.json."""
Snapshot = dict[str, np.ndarray]
"""Quantities of all robots at one time, by their keys (see agents/columns.py)."""
DECLARED, REACHED, NEITHER = "declared", "reached", "neither"
"""Outcomes of a trial: a robot has rightly declared a source; none has, but one has reached a source; neither."""
OUTCOMES = (DECLARED, REACHED, NEITHER)
OF_BELIEFS = ("peak_distance_m", "mean_distance_m", "expected_distance_m", "entropy_bits", "within_reach")
"""Names of the scores of a belief, see `scoring/beliefs.py`."""


def by_trial(group: "GroupRange", values: np.ndarray) -> np.ndarray:
    """Return the rows of a group's robots in an array over the swarm, as (trials, robots, ...)."""
    rows = values[group.start : group.start + group.trials * group.count]
    return rows.reshape(group.trials, group.count, *values.shape[1:])


def nearest_source(places: np.ndarray, sources: np.ndarray) -> np.ndarray:
    """Return the distance (...) [m] of positions (..., d) to the nearest source; infinite without any.

    sources: (..., m, d or more) [m]; NaN for a source that is not there.
    """
    apart = np.linalg.norm(places[..., None, :] - sources[..., : places.shape[-1]], axis=-1)
    return np.where(np.isnan(apart), np.inf, apart).min(axis=-1, initial=np.inf)


def declared_outcomes(
    group: "GroupRange",
    snapshot: Snapshot,
    sources_at: Callable[[np.ndarray], np.ndarray],
    rates: np.ndarray,
) -> Json:
    """Return the outcome of each trial of a group, as columns.

    sources_at: function from times (...) [s] to the sources' positions (..., m, dim) [m]. rates: of the sources, (m,)
    [kg/s], NaN if unknown.

    outcome: one of OUTCOMES, "declared" if both hold. A trial's declaration is the first right one of its team or,
    without a right one, the last: declared_time_s, since the group set off; localisation_error_m: from the declared
    position to the nearest source at that time; NaN without a declaration. declarations, false_declarations: of all
    robots, NaN if the group's algorithm never declares. reached_time_s: when the first robot came within reach of a
    source, or NaN. Of algorithms that estimate strengths also strength_error: |ln(q / q_true)| of the nearest source,
    0.69 for a factor of 2; and strength_covered: 1 if the interval of 90 % holds the true rate, else 0.
    """

    def table(name: str) -> np.ndarray:
        return by_trial(group, snapshot[name])

    declarations, false = table("declarations"), table("false_declarations")
    right, any_declared = declarations > false, (declarations > 0).any(axis=1)
    rightly = right.any(axis=1)
    time = np.where(declarations > 0, table("declared_time"), np.nan)
    first = np.where(right, time, np.inf).argmin(axis=1)
    last = np.where(declarations > 0, time, -np.inf).argmax(axis=1)
    judged = (np.arange(group.trials), np.where(rightly, first, last))
    apart = nearest_source(table("declared_position")[judged], sources_at(time[judged]))
    reached = np.nan_to_num(table("reached_time"), nan=np.inf).min(axis=1)
    speaks = declarations.any() or may_declare(group.model)

    def counted(values: np.ndarray) -> list[float]:
        total = values.sum(axis=1)
        return total.tolist() if speaks else [float("nan")] * len(total)

    def strength() -> Json:
        if not group.model.algorithm.estimates_rates:
            return {}
        place = table("declared_position")[judged]
        apart = np.linalg.norm(place[:, None] - sources_at(time[judged])[..., :2], axis=-1)
        true = rates[np.nan_to_num(apart, nan=np.inf).argmin(axis=1)] if len(rates) else np.nan
        rate, low, high = table("declared_rate")[judged].T
        known = any_declared & (true > 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            error = np.abs(np.log(rate / true))
        covered = ((low <= true) & (true <= high)).astype(float)
        values = {"strength_error": error, "strength_covered": covered}
        return {name: np.where(known, value, np.nan).tolist() for name, value in values.items()}

    begin = group.model.begin
    return {
        "outcome": np.where(rightly, DECLARED, np.where(np.isfinite(reached), REACHED, NEITHER)).tolist(),
        "declared_time_s": np.where(any_declared, time[judged] - begin, np.nan).tolist(),
        "localisation_error_m": np.where(any_declared & np.isfinite(apart), apart, np.nan).tolist(),
        "declarations": counted(declarations),
        "false_declarations": counted(false),
        "reached_time_s": np.where(np.isfinite(reached), reached - begin, np.nan).tolist(),
        **strength(),
    }


def may_declare(model: Group) -> bool:
    """Return whether robots of a group may, or have to, declare the position of a source."""
    return model.found == "declared" or model.algorithm.may_declare


def has_declared(trials: Mapping[str, Sequence[float | None]]) -> bool:
    """Return whether a robot has declared a source in any trial; trials: from `declared_outcomes` or a result.json."""
    return any(value is not None and value > 0 for value in trials.get("declarations", ()))
