"""``python fake_study.py OUT 'JSON' [OPTIONS]``: the study command on a plan and workers of no substance.

JSON: runs, airs, structures; base: what all runs do (`fake_labour`), changes: by number, what one does besides.
"""

import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fake_labour

from taichi_plume.cli.exit_codes import exit_code
from taichi_plume.cli.study import print_end
from taichi_plume.execution.signals import leave
from taichi_plume.studies import air_plan, scheduler
from taichi_plume.studies.messages import Axis, Request
from taichi_plume.studies.shards import shard_of
from taichi_plume.studies.study_run import Settings, execute


def plan_of(folder: Path, reported: dict[str, Any]) -> Any:
    """A plan whose runs have a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    texts = {"study.yaml": b"base: base.yaml\n", "base.yaml": b"name: fake\n"}
    runs, airs, structures = reported.get("runs", 60), reported.get("airs", 1), reported.get("structures", 1)
    changes = reported.get("changes", {})
    requests = tuple(
        Request(
            f"{n:016x}", n, n % 7, {"speed": n / 10}, n, n % airs, f"{n % airs:04x}", True,
            changes.get(str(n), {}), f"s{n % structures}",
        )
        for n in range(runs)
    )  # fmt: skip
    about = {
        "name": "fake",
        "base": "base.yaml",
        "kind": "sweep",
        "keep": (),
        "outcomes": {"value": "number"},
    }
    study = SimpleNamespace(**about, share_air="exact", model_dump=lambda mode: about)
    return SimpleNamespace(
        study=study, file=folder / "study.yaml", folder=folder, base={"duration": 60.0} | reported.get("base", {}),
        axes=(Axis("speed", "m/s", False),), requests=requests,
        texts=texts, classes={},
    )  # fmt: skip


def main() -> int:
    scheduler.work = fake_labour.work
    air_plan.why_not = fake_labour.why_not
    air_plan.scenario_of = lambda base, changes: base | changes
    out, reported, *options = sys.argv[1:]
    given: dict[str, Any] = {}
    for name, _, value in (one.lstrip("-").partition("=") for one in options):
        read = {"workers": int, "scheduler": str, "shard": shard_of}.get(name, lambda _: True)
        given[name.replace("-", "_")] = read(value)
    settings = Settings(Path(out), report=False, **given)
    plan = plan_of(Path(f"{out}-case"), json.loads(reported))
    report = None if settings.shard else False
    return exit_code(lambda: print_end(execute(plan, settings), quiet=False, report=report))


if __name__ == "__main__":
    leave(main())
