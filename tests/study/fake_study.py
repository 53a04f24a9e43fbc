"""``python fake_study.py OUT 'JSON' [OPTIONS]``: the study command on a plan and workers of no substance.

JSON: runs, airs, structures; base: what all runs do (`fake_labour`), changes: by number, what one does besides. Tables
are a text, so that these tests need nothing of what makes the real ones.
"""

import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fake_labour

from taichi_plume import study
from taichi_plume.running.signals import leave
from taichi_plume.study import campaign, sharing
from taichi_plume.study.messages import Axis, Request
from taichi_plume.study.study_run import Wishes, carry_out


def plan_of(folder: Path, told: dict[str, Any]) -> Any:
    """A plan, of files that are written to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "study.yaml").write_text("base: base.yaml\n")
    (folder / "base.yaml").write_text("name: fake\n")
    runs, airs, structures = told.get("runs", 60), told.get("airs", 1), told.get("structures", 1)
    changes = told.get("changes", {})
    requests = tuple(
        Request(
            f"{n:016x}", n, n % 7, {"speed": n / 10}, n, n % airs, f"{n % airs:04x}", True,
            changes.get(str(n), {}), f"s{n % structures}",
        )
        for n in range(runs)
    )  # fmt: skip
    about = SimpleNamespace(
        name="fake", base="base.yaml", kind="sweep", keep=(), outcomes={"number": "number"}, share_air="exact"
    )
    axes = (Axis("speed", "m/s", False),)
    return SimpleNamespace(
        study=about,
        file=folder / "study.yaml",
        folder=folder,
        base=told.get("base", {}),
        axes=axes,
        requests=requests,
    )


def without_tables() -> None:
    """Tables and page are a text each."""

    def write_plan(folder: Path, plan: Any) -> None:
        (folder / "plan.parquet").write_text("".join(f"{one.run}\n" for one in plan.requests))

    def publish(folder: Path, records: Any) -> None:
        lines = sorted(json.dumps(one[:-1]) for one in records)
        (folder / "table.txt").write_text("\n".join(lines))

    def write(folder: Path) -> Path:
        (folder / "report.html").write_text("page")
        return folder / "report.html"

    for name, made in (
        ("tables", SimpleNamespace(write_plan=write_plan, publish=publish)),
        ("page", SimpleNamespace(write=write)),
    ):
        sys.modules[f"taichi_plume.study.{name}"] = made  # pyright: ignore[reportArgumentType]
        setattr(study, name, made)


def main() -> int:
    without_tables()
    campaign.work = fake_labour.work
    sharing.why_not = fake_labour.why_not
    sharing.scenario_of = lambda base, changes: base | changes
    out, told, *options = sys.argv[1:]
    given = {
        name.lstrip("-").replace("-", "_"): value
        for name, _, value in (one.partition("=") for one in options)
    }
    wishes = Wishes(Path(out))._replace(
        **{
            name: value == "" if name not in ("workers", "scheduler") else value
            for name, value in given.items()
        }
    )
    if wishes.workers:
        wishes = wishes._replace(workers=int(wishes.workers))
    return carry_out(plan_of(Path(f"{out}-case"), json.loads(told)), wishes)


if __name__ == "__main__":
    leave(main())
