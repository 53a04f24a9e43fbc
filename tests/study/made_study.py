"""A plan of a study and what came of its runs, without running any."""

import itertools
from collections.abc import Callable, Iterable
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from taichi_plume.studies import tables
from taichi_plume.studies.messages import Axis, Cost, Record, Request
from taichi_plume.studies.results import Results, open_study
from taichi_plume.studies.store import Store, table_of

AXES = {
    "speed": Axis("speed", "m/s", True),
    "count": Axis("count", "", True),
    "open": Axis("open", "", True),
    "algorithm of all": Axis("algorithm of all", "", True),
}
VALUES: dict[str, tuple[Any, ...]] = {
    "speed": (0.2, 1, 0.5),
    "count": (1, 3),
    "open": (True, False),
    "algorithm of all": ("casting", "spiral/50 %"),
}


def name(*of: Any) -> str:
    return sha256(repr(of).encode()).hexdigest()[:16]


def plan(
    axes: dict[str, Axis] | None = None,
    points: Iterable[tuple[Any, ...]] | None = None,
    airs: int = 3,
    searches: int = 1,
    by_chance: bool = True,
    varied: dict[str, Any] | None = None,
    **study: Any,
) -> SimpleNamespace:
    """As studies/plan.py makes it; points: values of the axes, unless given all of VALUES; varied: axes of the file."""
    axes = AXES if axes is None else axes
    points = itertools.product(*VALUES.values()) if points is None else points
    requests = []
    for point, values in enumerate(points):
        for air, search in itertools.product(range(airs), range(searches)):
            by_name = dict(zip(axes, values, strict=True))
            wind = {key: value for key, value in by_name.items() if not isinstance(value, str)}
            seed = 7 + air + 1000003 * search
            requests.append(
                Request(
                    run=name(by_name, seed), number=len(requests), point=point, values=by_name, seed=seed,
                    air_seed=7 + air, air=name(wind, air if by_chance else 0), air_by_chance=by_chance,
                    changes={}, structure="s",
                )
            )  # fmt: skip
    reported = {
        "name": "fake", "kind": "sweep", "airs": airs, "searches": searches, "sampling": None,
        "axes": varied or {one: {"key": one} for one in axes},
        "outcomes": PATHS, **study,
    }  # fmt: skip
    return SimpleNamespace(
        study=SimpleNamespace(model_dump=lambda mode: reported),
        file=Path("study.yaml"), folder=Path(), base={"duration": 60.0}, axes=tuple(axes.values()),
        requests=tuple(requests),
    )  # fmt: skip


def trial(n: int = 0, success: bool | None = True, time: float = 10.0, **more: Any) -> dict[str, Any]:
    """A row as a worker makes it."""
    found = bool(success)
    return {
        "group": "robots", "algorithm": "casting", "trial": n, "searched": success is not None, "success": success,
        "found": int(found), "time_s": time if found else None, "path_m": 2 * time if found else None,
        "overhead": 2.0 if found else None, "team_path_m": 2 * time, "acquisitions": 3, "hits": 2, "bumps": 0,
        "final_distance_m": 0.1, "time_with_failures_s": time if found else (60.0 if success is False else None),
        "outcome": None if success is None else "reached" if found else "neither", "declared_time_s": None,
        "localisation_error_m": None, "declarations": None, "false_declarations": None,
        "reached_time_s": time if found else None, "shares_arena": False, **more,
    }  # fmt: skip


PATHS = {"correlation": "maps.0.correlation", "error": "maps.0.mae_ppm"}
"""Of outcomes, under which records tell them."""


def record(request: Request, trials: list[dict[str, Any]] | None = None, **more: Any) -> Record:
    """What came of a run; more: other fields of the record."""
    cost = Cost(1e9 + request.number, 2.0, 1.5, 0, f"tcp://127.0.0.1:{request.number % 2}")
    trials = [trial(0), trial(1, False), trial(2, None)] if trials is None else trials
    outcomes = more.pop("outcomes", {"correlation": 0.5, "error": None})
    reported = {PATHS[name]: value for name, value in outcomes.items()}
    return Record(request.run, "completed", "", trials, reported, cost)._replace(**more)


def records(plan: Any, make: Callable[[Request], Record] = record) -> list[Record]:
    return [make(one) for one in plan.requests]


def add(folder: Path, records: list[Record]) -> None:
    """Write another part, as a study does with what a task brought."""
    store = Store(folder)
    store.parts.mkdir(exist_ok=True)
    store._next = len(list(store.parts.iterdir()))
    store.add(records)


def published(folder: Path, plan: Any, records: list[Record]) -> Results:
    """The results of a study whose plan and tables are written to a folder."""
    tables.write_plan(folder, plan)
    tables.publish(folder, lambda: table_of(records))
    return open_study(folder)


def searches(seed: int, rate: Callable[[dict[str, Any], np.random.Generator], float], trials: int = 1) -> Any:
    """A maker of records whose robots find the source with a chance that the point and the air decide."""

    def make(request: Request) -> Record:
        of_air = np.random.default_rng([seed, int(request.air, 16) % 2**32])
        of_run = np.random.default_rng([seed, int(request.run, 16) % 2**32])
        p = rate(request.values, of_air)
        rows = [trial(n, bool(of_run.random() < p), float(of_run.uniform(5, 50))) for n in range(trials)]
        return record(request, rows)

    return make
