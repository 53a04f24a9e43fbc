"""What robots said of the source's place, judged: how a trial ended, and how far off its declaration was."""

from typing import Any

import numpy as np

DECLARED, REACHED, NEITHER = "declared", "reached", "neither"
"""How a trial ends: a robot has said rightly where a source is; none has, but one has come to a source; neither."""
OUTCOMES = (DECLARED, REACHED, NEITHER)
OF_BELIEFS = ("peak_distance_m", "mean_distance_m", "expected_distance_m", "entropy_bits", "within_reach")
"""What tells how good a belief is, see `belief_scores`."""


def declared_outcomes(
    group: Any, snapshot: dict[str, np.ndarray], sources: np.ndarray
) -> dict[str, list[Any]]:
    """Per trial of a group, as columns; sources: (m, 2) [m].

    outcome: one of OUTCOMES, "declared" where both hold. A trial's declaration is the first right one of its team or,
    where there is none, the last: declared_time_s, since the group set off; localisation_error_m: from it to the
    nearest source; NaN without one. declarations, false_declarations: of all its robots, NaN where the group's
    algorithm never declares. reached_time_s: when the first robot came within reach of a source, NaN where none did.
    """
    span = slice(group.start, group.start + group.trials * group.count)

    def table(name: str) -> np.ndarray:
        return snapshot[name][span].reshape(group.trials, group.count, *snapshot[name].shape[1:])

    said, false = table("declarations"), table("false_declarations")
    right, any_said = said > false, (said > 0).any(axis=1)
    rightly = right.any(axis=1)
    time = np.where(said > 0, table("declared_time"), np.nan)
    first = np.where(right, time, np.inf).argmin(axis=1)
    last = np.where(said > 0, time, -np.inf).argmax(axis=1)
    its = (np.arange(group.trials), np.where(rightly, first, last))
    apart = np.linalg.norm(table("declared_position")[its][:, None] - sources, axis=-1).min(
        axis=1, initial=np.inf
    )
    reached = np.nan_to_num(table("reached_time"), nan=np.inf).min(axis=1)
    speaks = said.any() or may_declare(group.model)

    def counted(values: np.ndarray) -> list[Any]:
        total = values.sum(axis=1)
        return total.tolist() if speaks else [float("nan")] * len(total)

    begin = group.model.begin
    return {
        "outcome": np.where(rightly, DECLARED, np.where(np.isfinite(reached), REACHED, NEITHER)).tolist(),
        "declared_time_s": np.where(any_said, time[its] - begin, np.nan).tolist(),
        "localisation_error_m": np.where(any_said & np.isfinite(apart), apart, np.nan).tolist(),
        "declarations": counted(said),
        "false_declarations": counted(false),
        "reached_time_s": np.where(np.isfinite(reached), reached - begin, np.nan).tolist(),
    }


def may_declare(model: Any) -> bool:
    """Whether robots of a group's model may say where a source is, or have to."""
    return model.found == "declared" or model.algorithm.may_declare


def has_declared(trials: dict[str, Any]) -> bool:
    """Whether a robot has declared in any of the trials that `declared_outcomes` or a result.json tells of."""
    return any(value is not None and value > 0 for value in trials.get("declarations", ()))
