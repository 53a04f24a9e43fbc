"""What robots meet in an air that is shown to them is what they meet in the air itself, to the bit."""

from typing import Any

import numpy as np
import pytest
import tasks
from study_rooms import ROOM, UNIFORM, changed

from taichi_plume.files.shared_film import AirFilm, AirFilmError, NewAirFilm
from taichi_plume.results.run import open_run
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.studies.air_plan import why_not
from taichi_plume.studies.shared_air import solve_air
from taichi_plume.studies.task_execution import execute_task

pytestmark = pytest.mark.slow

KEEP = ("robots.parquet",)
MAPS = {
    "mae": "maps.0.per_trial.mae_ppm.0",
    "error": "maps[1].mean_gas.error_ppm.0",
    "peak": "maps[1].mean_gas.peak_distance_m.0",
}
OPEN = ROOM["wind"]["openings"]
SOURCE = ROOM["gas"]["sources"]
HEAVY = {"kind": "eulerian", "species": "acetone", "sources": [{"position": [0.3, 1.0], "rate": 2e-3}]}
CHANGES = ({"robots.0.algorithm.threshold_ppm": 1.0}, {"robots.0.algorithm.threshold_ppm": 3.0})
ROOM_3D = changed(
    ROOM,
    duration=1.0,
    domain={"size": [2.0, 1.5, 0.5], "spacing": 0.1},
    gas={"kind": "eulerian", "species": "acetone", "sources": [{"position": [0.3, 0.6, 0.2], "rate": 1e-3}]},
    obstacles=[{"kind": "sphere", "center": [0.9, 1.1, 0.2], "radius": 0.17}],
)
CASES: dict[str, dict[str, Any]] = {
    "moving obstacle": changed(
        ROOM,
        obstacles=[
            *ROOM["obstacles"],
            {"kind": "cylinder", "center": [1.5, 1.1], "radius": 0.1, "motion": {"path": [[2, 1.5, 0.9]]}},
        ],
    ),
    "frozen": changed(ROOM, wind={"kind": "frozen", "after": 0.9, "openings": OPEN}),
    "mixture": changed(
        ROOM,
        gas={
            "kind": "mixture",
            "parts": [
                ROOM["gas"],
                {**HEAVY, "inflow": [{"opening": 0, "concentration": 3.0}]},
                {"kind": "eulerian", "sources": [{"position": [0.4, 0.3], "rate": 3e-6}]},
            ],
        },
    ),
    "gusts over gas on the grid": changed(
        ROOM,
        obstacles=[],
        wind={"kind": "uniform", "velocity": [0.5, 0.05], "gusts": {"intensity": 0.3, "time": 0.5}},
    ),
    "gusts, and a closed form beside": changed(
        ROOM,
        obstacles=[],
        wind={"kind": "uniform", "velocity": [0.5, 0.05], "gusts": {"intensity": 0.3, "time": 0.5}},
        gas={
            "kind": "mixture",
            "parts": [
                ROOM["gas"],
                {"kind": "meandering", "sources": [{"position": [0.3, 0.3], "rate": 1e-5}]},
            ],
        },
    ),
    "closed room": changed(
        ROOM, obstacles=[], wind={"kind": "synthetic", "speed": 0.3, "longest": 2.0, "circulation": 0.2}
    ),
    "3-D": ROOM_3D,
    "heat and heavy gas": changed(
        ROOM_3D,
        wind={
            "kind": "cfd",
            "openings": OPEN,
            "buoyancy": {
                "solutal": True,
                "heat": {"walls": [{"face": "z-", "temperature": 310.0}]},
            },
        },
    ),
}  # fmt: skip


def differences(base: dict[str, Any], folder: Any, changes: Any = CHANGES) -> list[str]:
    """What differs between runs that are shown an air, and runs that solve it."""
    outcomes = MAPS if base.get("maps") else {}
    scenario = Scenario.model_validate(base)
    assert why_not(scenario, outcomes, "exact", KEEP) is None
    film = folder / "airs" / "one.zarr"
    own, shown = folder / "own", folder / "shown"
    record = solve_air(tasks.task(base, changes, shown, film))
    assert not record.message
    assert record.frames == AirFilm(film).frames == scenario.last_tick + 1
    assert record.bytes > 0
    alone = execute_task(tasks.task(base, changes, own, keep=KEEP, outcomes=outcomes))
    together = execute_task(tasks.task(base, changes, shown, film, keep=KEEP, outcomes=outcomes))
    found = []
    for one, other in zip(alone, together, strict=True):
        assert one.status in ("completed", "stopped"), one.message
        found += [] if one._replace(cost=other.cost) == other else [f"records: {one}, {other}"]
        tables = [open_run(place / "kept" / one.run).robots for place in (own, shown)]
        assert np.asarray(tables[0]["reading_ppm"]).max() > 1.0
        assert None not in one.outcomes.values()
        for name in tables[0]:
            a, b = (np.asarray(table[name]) for table in tables)
            same = np.array_equal(a, b, equal_nan=True) if a.dtype.kind == "f" else np.array_equal(a, b)
            found += [] if same else [f"robots.parquet: {name}"]
    return found


def test_a_search_in_a_shared_air_is_that_in_its_own_to_the_bit(tmp_path):
    assert not differences(ROOM, tmp_path)


@pytest.mark.parametrize("case", CASES)
def test_that_holds_of_other_airs(case, tmp_path):
    assert not differences(CASES[case], tmp_path)


@pytest.mark.parametrize(
    ("sections", "outcomes", "share", "keep", "why"),
    [
        ({}, MAPS, "exact", KEEP, None),
        ({}, {}, "never", (), "never"),
        ({"robots": []}, {}, "exact", (), "no robots"),
        ({"robots": [ROOM["robots"][0] | {"wake": True}]}, {}, "always", (), "stir"),
        ({"gas": ROOM["gas"] | {"kind": "puffs"}}, {}, "exact", (), "finer"),
        ({"gas": ROOM["gas"] | {"kind": "puffs"}}, {}, "always", (), None),
        ({}, {"mass": "gas.emitted_kg"}, "exact", (), "outcomes.mass"),
        ({}, {"wind": "probes.a.wind_x"}, "always", (), "outcomes.wind"),
        ({}, {}, "exact", ("fields.zarr",), "keep: fields.zarr"),
        ({}, {}, "exact", ("result.json",), "keep: result.json"),
        ({"wind": UNIFORM["wind"], "gas": UNIFORM["gas"]}, {}, "always", (), "a film saves nothing"),
        ({"wind": UNIFORM["wind"]}, {}, "exact", (), None),
    ],
)
def test_why_an_air_is_not_shared_is_said(sections, outcomes, share, keep, why):
    reported = why_not(Scenario.model_validate(changed(ROOM, **sections)), outcomes, share, keep)
    assert reported is None if why is None else why in reported


def test_gas_of_puffs_is_shared_by_its_cells_where_that_is_wanted(tmp_path):
    base = changed(ROOM, gas=ROOM["gas"] | {"kind": "puffs"})
    film = tmp_path / "one.zarr"
    task = tasks.task(base, [{}], tmp_path / "shown", film, keep=KEEP, structure="puffs")
    assert not solve_air(task).message
    (shown,) = execute_task(task)
    (alone,) = execute_task(task._replace(film=None, options=task.options._replace(out=tmp_path / "own")))
    assert shown.status == alone.status == "completed"
    read = [open_run(tmp_path / n / "kept" / alone.run).robots["reading_ppm"] for n in ("shown", "own")]
    first = slice(0, 6)  # before what they read lets them part
    assert read[0].to_numpy()[:12].max() >= 0
    np.testing.assert_array_equal(read[0][first], read[1][first])


def test_an_air_that_fails_is_reported_and_leaves_nothing(tmp_path):
    base = changed(ROOM, gas=ROOM["gas"] | {"sources": [{"position": [0.9, 1.1], "rate": 1e-5}]})
    record = solve_air(tasks.task(base, [{}], tmp_path, tmp_path / "airs" / "a.zarr", structure="no air"))
    assert "inside obstacles" in record.message
    assert record.frames == 0
    assert not (tmp_path / "airs").exists()


def test_who_films_an_air_again_is_not_disturbed_by_who_did(tmp_path):
    path, frame = tmp_path / "one.zarr", {"gas_0": np.ones((4, 3), np.float32)}
    old, new = (NewAirFilm(path, (2, 1), ("gas_0",), 0.1, 2) for _ in range(2))
    for film in (new, old, new):
        film.append(frame)
    old.append(frame)
    with pytest.raises(FileNotFoundError):
        old.close()
    old.discard()
    new.close()
    assert AirFilm(path).frames == 2
    assert [one.name for one in tmp_path.iterdir()] == ["one.zarr"]


def test_a_film_that_is_gone_or_damaged_fails_its_runs_in_a_line(tmp_path):
    film = tmp_path / "airs" / "one.zarr"
    task = tasks.task(changed(ROOM), [{}], tmp_path, film)
    (gone,) = execute_task(task)
    assert (gone.status, "one.zarr" in gone.message) == ("failed", True)
    assert not solve_air(task).message
    assert execute_task(task)[0].status == "completed"
    chunk = next(path for path in (film / "gas_0" / "c").rglob("*") if path.is_file())
    chunk.write_bytes(chunk.read_bytes()[:-50] + bytes(50))
    meta = film / "zarr.json"
    meta.write_bytes(meta.read_bytes())  # as another film of that name
    (bad,) = execute_task(task)
    assert bad.status == "failed"
    assert "damaged" in bad.message
    chunk.unlink()
    with pytest.raises(AirFilmError, match="gas_0 has"):
        AirFilm(film)


def test_a_film_that_does_not_fit_is_not_shown(tmp_path):
    film = tmp_path / "one.zarr"
    assert not solve_air(tasks.task(changed(ROOM), [{}], tmp_path, film)).message
    for sections in ({"duration": 9.0}, {"tick": 0.05}):
        (record,) = execute_task(
            tasks.task(changed(ROOM, **sections), [{}], tmp_path, film, structure=str(sections))
        )
        assert record.status == "failed"
        assert "film of the air" in record.message


def test_a_film_too_long_for_the_memory_is_read_on(tmp_path):
    film = tmp_path / "one.zarr"
    assert not solve_air(tasks.task(changed(ROOM), [{}], tmp_path, film)).message
    whole, short = AirFilm(film, 1 << 30), AirFilm(film, 80_000)
    for n in (*range(whole.frames), 3):
        for name, values in whole.frame(n).items():
            np.testing.assert_array_equal(values, short.frame(n)[name])
    assert 0 < short.held <= 80_000 < whole.held
    with pytest.raises(AirFilmError, match="ends at tick 20"):
        whole.frame(21)
