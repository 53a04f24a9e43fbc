"""Tasks as a plan makes them: requests of changes to a base scenario."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taichi_plume.studies.messages import Options, Request, Task


def request(number: int, changes: Mapping[str, Any], structure: str = "a", air: str = "air") -> Request:
    """A run of that scenario; its values are those of the changes."""
    run = hashlib.sha256(json.dumps([structure, changes], sort_keys=True).encode()).hexdigest()[:16]
    values = {path.replace(".", "_"): v for path, v in changes.items() if isinstance(v, int | float | str)}
    return Request(
        run, number, number, values, changes.get("seed", 0), 0, air, True, dict(changes), structure
    )


def task(
    base: Mapping[str, Any],
    changes: Sequence[Mapping[str, Any]],
    out: Path,
    film: Path | None = None,
    structure: str = "a",
    **options: Any,
) -> Task:
    """Runs of a structure in the folder `out`."""
    given = {"keep": (), "outcomes": {}, "allow_code": False, "allow_outside": False, "classes": {}}
    requests = tuple(request(n, one, structure) for n, one in enumerate(changes))
    return Task(dict(base), out, requests, Options(out=out, **(given | options)), film)
