"""Which runs of a plan are still to be done."""

from typing import TYPE_CHECKING

from taichi_plume.scenario.loading import scenario_of
from taichi_plume.study.outcomes import not_left
from taichi_plume.study.store import DONE, KEPT, Store

if TYPE_CHECKING:
    from taichi_plume.study.messages import Request
    from taichi_plume.study.plan import Plan


def todo(plan: "Plan", store: Store, retry: bool) -> "list[Request]":
    """Those that are not there, those that failed, if by `retry`, and those made before the study asked for more.

    Such as an outcome, or a file to keep: neither is part of a run's id. Raises StoreError.
    """
    statuses, less = store.statuses(), _with_less(plan, store)
    return [
        one
        for one in plan.requests
        if one.run not in statuses or one.run in less or (retry and statuses[one.run] not in DONE)
    ]


def _with_less(plan: "Plan", store: Store) -> set[str]:
    """Runs that are done, without all that the study asks for."""
    paths, keep = set(plan.study.outcomes.values()), plan.study.keep
    if not paths and not keep:
        return set()
    less, lacking = set(), {}
    for one in store.records():
        if one.status in DONE:
            if not paths <= one.outcomes.keys():
                less.add(one.run)
            lacking[one.run] = [name for name in keep if not (store.folder / KEPT / one.run / name).exists()]
    left: dict[tuple[int, str], bool] = {}  # by point: of some that a study keeps, not all points have a file
    for request in plan.requests:
        for name in lacking.get(request.run, ()):
            key = request.point, name
            if key not in left:
                left[key] = not_left(name, scenario_of(plan.base, request.changes)) is None
            if left[key]:
                less.add(request.run)
    return less
