"""What `--check` tells of a study: how many runs it makes, and of what."""

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from taichi_plume.guard.terminal import LONGEST_VALUE, say, show, visible

if TYPE_CHECKING:
    from taichi_plume.study.plan import Plan

POINTS = 10  # that are shown


def print_check(plan: "Plan", out: Path) -> None:
    """Print how many runs, points and airs a plan has, and its first points."""
    requests = plan.requests
    runs_of = Counter(one.air for one in requests)
    structures = len({one.structure for one in requests})
    points = {one.point: one for one in reversed(requests)}
    several = sum(count for count in runs_of.values() if count > 1)
    say(visible(f"study {plan.study.name} ({plan.study.kind}) of {plan.study.base}, into {out}"))
    say(f"runs: {len(requests):,}, at {len(points):,} points")
    shared = f"; {several:,} runs share theirs with others" if several else ""
    say(f"airs: {len(runs_of):,}{shared}")
    say(f"structures, each compiled once by a worker: {structures:,}")
    table = Table(
        "point", "runs", *(f"{axis.name} [{axis.unit}]" if axis.unit else axis.name for axis in plan.axes)
    )
    count = Counter(one.point for one in requests)
    for point, request in sorted(points.items())[:POINTS]:
        values = (request.values.get(axis.name) for axis in plan.axes)
        table.add_row(str(point), str(count[point]), *(_shown(value) for value in values))
    show(table)
    if len(points) > POINTS:
        say(f"... and {len(points) - POINTS:,} points more")


def _shown(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else visible(value, LONGEST_VALUE)
