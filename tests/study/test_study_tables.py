import random
import shutil
from math import inf, isnan
from pathlib import Path

import made_study
import pandas as pd
import polars as pl
import pyarrow.parquet as pq
import pytest

from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.studies import columns, tables
from taichi_plume.studies.estimates import SUCCESS
from taichi_plume.studies.messages import Axis
from taichi_plume.studies.results import open_study
from taichi_plume.studies.store import Store, table_of

LUCKY = {(7, 0), (8, 0), (8, 1), (10, 0), (10, 1), (10, 2), (13, 2), (14, 1)}
"""Seeds of airs, and trials that succeed in them."""


@pytest.fixture
def plan():
    return made_study.plan()


@pytest.fixture
def folder(tmp_path, plan):
    return made_study.published(tmp_path, plan, made_study.records(plan)).folder


def files(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*.parquet")
        if path.name != tables.COSTS and "parts" not in path.parts
    }


def test_bytes_do_not_tell_how_the_runs_came(tmp_path, plan):
    one, other = tmp_path / "one", tmp_path / "other"
    records = made_study.records(plan)
    for place in (one, other):
        place.mkdir()
        tables.write_plan(place, plan)
    tables.publish(one, lambda: table_of(records))
    shuffled = [record._replace(cost=record.cost._replace(begun=5.0, worker="x")) for record in records]
    random.Random(1).shuffle(shuffled)
    failed = [record._replace(status="failed", trials=[], message="lost") for record in records[:7]]
    for so_far in (shuffled[:20], shuffled[:50], failed[:3] + shuffled + failed[3:] + shuffled[:9]):
        made_study.add(other, so_far)
        tables.publish(other, Store(other).table)
    assert files(one) == files(other)
    assert len(files(one)) == 2 + 24
    assert {path.name for path in other.iterdir()} == {
        "plan.parquet",
        "runs.parquet",
        "costs.parquet",
        "trials",
        "parts",
    }


def test_pandas_polars_and_duckdb_read_the_trials_in_a_line(folder, plan):
    duckdb = pytest.importorskip("duckdb")
    place = folder / "trials"
    by_pandas = pd.read_parquet(place)
    by_polars = pl.read_parquet(place / "**/*.parquet", hive_partitioning=True)
    reported = duckdb.sql(f"from '{place}/**/*.parquet'")
    assert {str(by_pandas[name].dtype) for name in ("success", "open")} == {"boolean"}
    assert {str(by_pandas[name].dtype) for name in ("count", "hits", "seed")} == {"Int64"}
    assert {by_polars[name].dtype for name in ("success", "open")} == {pl.Boolean}
    assert {by_polars[name].dtype for name in ("count", "hits", "seed")} == {pl.Int64}
    kinds = dict(zip(reported.columns, map(str, reported.types), strict=True))
    assert {kinds[name] for name in ("success", "open")} == {"BOOLEAN"}
    assert {kinds[name] for name in ("count", "hits", "seed")} == {"BIGINT"}
    for kind in (
        str(by_pandas["speed"].dtype),
        str(by_polars["speed"].dtype).lower(),
        kinds["speed"].lower(),
    ):
        assert kind in ("float64", "double")
    mean = "avg(time_s), count(*), count(success), sum(success::int)"
    of_one = duckdb.sql(
        f"select {mean} from '{place}/**/*.parquet' where speed = 0.2 and \"algorithm of all\" = 'spiral/50 %'"
    ).fetchall()[0]
    runs = 2 * 2 * 3  # counts, doors, airs
    assert of_one == (10.0, 3 * runs, 2 * runs, runs)
    for frame in (by_pandas, by_polars.to_pandas()):
        some = frame[(frame["speed"] == 0.2) & (frame["algorithm of all"] == "spiral/50 %")]
        assert (some["time_s"].mean(), len(some), some["success"].count(), some["success"].sum()) == of_one
    assert by_pandas.attrs["units"]["speed"] == "m/s"


def test_what_is_read_is_what_came(folder, plan):
    results = open_study(folder)
    trials, runs, costs = results.trials(), results.runs(), results.costs()
    assert list(runs["run"]) == [one.run for one in plan.requests]
    assert list(trials["run"]) == [one.run for one in plan.requests for _ in range(3)]
    assert list(trials["trial"]) == [0, 1, 2] * len(plan.requests)
    assert list(trials["success"][:3]) == [True, False, pd.NA]
    assert list(trials["speed"][::3]) == [one.values["speed"] for one in plan.requests]
    assert trials[["air_seed", "seed"]].iloc[[0, 3]].to_numpy().tolist() == [[7, 7], [7 + 1, 7 + 1]]
    assert trials.attrs["units"]["time_s"] == "s"
    assert set(runs["correlation"]) == {0.5}
    assert list(runs["error"].dropna()) == []
    assert runs.attrs["units"]["error"] == "ppm"
    assert sum(costs["total_s"]) == 2 * len(plan.requests)
    assert results.polars("trials")["success"].to_list() == [True, False, None] * len(plan.requests)
    assert "72 completed" in repr(results)


def test_a_study_that_is_not_finished_is_read_from_what_tasks_brought(tmp_path, plan):
    tables.write_plan(tmp_path, plan)
    assert set(open_study(tmp_path).runs()["status"]) == {"missing"}
    assert len(open_study(tmp_path).trials()) == 0
    records = made_study.records(plan)
    made_study.add(tmp_path, records[5:25])
    assert list(open_study(tmp_path).runs()["status"]).count("completed") == 20
    tables.publish(tmp_path, Store(tmp_path).table)
    made_study.add(tmp_path, records[25:])  # after the tables: killed before they were made again
    results = open_study(tmp_path)
    assert list(results.runs()["status"]) == ["missing"] * 5 + ["completed"] * (len(records) - 5)
    assert len(results.trials()) == 3 * (len(records) - 5)


def test_a_kill_between_the_steps_leaves_what_can_be_read(tmp_path, plan, monkeypatch):
    """Whichever step of writing comes last."""
    tables.write_plan(tmp_path, plan)
    records = made_study.records(plan)
    made_study.add(tmp_path, records[:30])
    tables.publish(tmp_path, lambda: table_of(records[:30]))
    made_study.add(tmp_path, records[30:])
    real = {"rename": Path.rename, "replace": tables.disk.os.replace}
    for last in range(8):
        steps = [0]

        def step(kind, *how, last=last, steps=steps):
            if steps[0] == last:
                raise KeyboardInterrupt
            steps[0] += 1
            return real[kind](*how)

        with monkeypatch.context() as patch:
            patch.setattr(Path, "rename", lambda *how, step=step: step("rename", *how))
            patch.setattr(tables.disk.os, "replace", lambda *how, step=step: step("replace", *how))
            try:
                tables.publish(tmp_path, lambda: table_of(records))
            except KeyboardInterrupt:
                assert last < 29
        assert set(open_study(tmp_path).runs()["status"]) == {"completed"}
        assert len(open_study(tmp_path).trials()) == 3 * len(records)
    tables.publish(tmp_path, lambda: table_of(records))
    clean = tmp_path / "clean"
    clean.mkdir()
    made_study.published(clean, plan, records)
    assert {k: v for k, v in files(tmp_path).items() if not k.startswith("clean")} == files(clean)


def test_no_trials_no_axes_no_folders(tmp_path):
    plan = made_study.plan({}, [()], outcomes={})
    records = made_study.records(plan, lambda one: made_study.record(one, []))
    results = made_study.published(tmp_path, plan, records)
    assert [path.name for path in (tmp_path / "trials").iterdir()] == ["part-0.parquet"]
    assert len(pd.read_parquet(tmp_path / "trials")) == 0
    assert len(results.runs()) == 3


@pytest.mark.parametrize(("name", "values"), [("seed", [7]), ("algorithm", ["fast casting", "spiral"])])
def test_an_axis_may_be_a_column_of_the_tables(tmp_path, name, values):
    plan = made_study.plan({name: Axis(name, "", True)}, [(value,) for value in values], airs=1)
    results = made_study.published(tmp_path, plan, made_study.records(plan))
    assert list(results.trials()[name][::3]) == values
    assert name not in columns.taken()
    assert {"run", "success", "status", "c"} <= columns.taken(["c"])


def test_what_cannot_be_used_is_reported_in_a_line(folder):
    def fault() -> str:
        with pytest.raises(RunFolderError) as reported:
            open_study(folder).trials()
        assert "\n" not in str(reported.value)
        return str(reported.value)

    with pytest.raises(RunFolderError, match="does not exist; give the folder of a study"):
        open_study(folder / "gone")
    with pytest.raises(RunFolderError, match="is not the folder of a study"):
        open_study(folder / "trials")
    (folder / "parts").mkdir()
    (folder / "parts" / "000000.parquet").write_bytes(b"damage")  # newer than the tables
    assert fault().startswith(f"{folder / 'parts' / '000000.parquet'}: cannot be read")
    shutil.rmtree(folder / "parts")
    part = next((folder / "trials").rglob("*.parquet"))
    whole = part.read_bytes()
    part.write_bytes(whole[:100])
    assert "is damaged" in fault()
    part.unlink()
    assert "holds 213 of 216 rows" in fault() or "holds 207 of 216 rows" in fault()
    part.write_bytes(whole[:30] + bytes([whole[30] ^ 255]) + whole[31:])
    assert "is damaged" in fault()
    table = pq.read_table(folder / "plan.parquet")
    about = table.schema.metadata[b"study"].replace(b'"version": "0', b'"version": "9')
    pq.write_table(table.replace_schema_metadata({b"study": about}), folder / "plan.parquet")
    assert "was made by taichi_plume 9" in fault()
    pq.write_table(table.replace_schema_metadata({}), folder / "plan.parquet")
    assert "plan.parquet: is damaged" in fault()
    (folder / "plan.parquet").write_bytes(b"PAR1")
    assert "plan.parquet: is damaged" in fault()


def test_points_are_means_over_airs(tmp_path):
    axes = {"speed": Axis("speed", "m/s", True), "algorithm": Axis("algorithm", "", True)}
    plan = made_study.plan(
        axes, [(s, a) for s in (0.2, 0.5) for a in ("casting", "spiral")], airs=8, searches=5
    )
    air = {one.air: n / 10 for n, one in enumerate(plan.requests[::5])}

    def rows(one):
        n = round(10 * air[one.air]) + (one.seed // 1000003) + 2 * (one.values["algorithm"] == "spiral")
        return made_study.record(one, [made_study.trial(0, n % 3 == 0, 20.0), made_study.trial(1, False)])

    records = made_study.records(plan, rows)
    records[0] = records[0]._replace(status="failed", message="lost", trials=[])
    results = made_study.published(tmp_path, plan, records[:-1])
    points, trials = results.points(), results.trials()
    assert list(points["speed"]) == [0.2, 0.2, 0.5, 0.5]
    assert list(points["failed"]) == [1, 0, 0, 0]
    assert list(points["missing"]) == [0, 0, 0, 1]
    means = points.to_dict("records")
    searched = trials.to_dict("records")
    for n, row in enumerate(means):
        some = [one for one in searched if one["point"] == n]
        assert row["success"] == pytest.approx(sum(one["success"] for one in some) / len(some))
        times = [one["time_with_failures_s"] for one in some]
        assert row["time_with_failures_s"] == pytest.approx(sum(times) / len(times))
        assert row["success_low"] < row["success"] < row["success_high"]
    assert means[1]["success_words"].endswith("over 8 airs")
    assert "of 80 searches" in means[1]["success_words"]
    assert points.attrs["units"]["time_with_failures_s_low"] == "s"
    assert means[0]["correlation"] == 0.5
    apart = results.differences("algorithm")
    assert list(apart["second"]) == ["spiral", "spiral"]
    assert list(apart["apart"])[1] == pytest.approx(means[3]["success"] - means[2]["success"], abs=0.02)
    assert list(apart["airs"]) == [8, 8]
    with pytest.raises(ValueError, match="there are speed, algorithm"):
        results.differences("rate")
    speeds = results.differences("speed")  # of the wind: no air at one speed is that at the other
    assert speeds["airs"].tolist() == [0, 0]
    for words in speeds["words"]:
        assert all(part in words for part in ("no air in common", "speed = 0.2 and 0.5", "points()")), words


def test_a_difference_of_shares_lies_between_minus_one_and_one(tmp_path):
    axes = {"algorithm": Axis("algorithm", "", True)}
    plan = made_study.plan(axes, [("casting",), ("spiral",)], airs=4)

    def rows(one):  # in two airs both find it; in the others only the second
        both = one.air_seed % 2 == 0
        return made_study.record(one, [made_study.trial(0, both or one.values["algorithm"] == "spiral")])

    apart = made_study.published(tmp_path, plan, made_study.records(plan, rows)).differences("algorithm")
    assert list(apart["apart"]) == [0.5]
    assert 0.5 < max(apart["high"]) < 1.0
    assert -1.0 < min(apart["low"]) < 0.0


@pytest.mark.parametrize("airs", [2, 3, 6])
def test_intervals_of_a_study_keep_to_the_range_of_each_quantity(tmp_path, airs):
    """Times of 10 to 59 of 60 s, ways, correlations near 1 and errors near 0; no interval below three airs."""
    plan = made_study.plan({}, [()], airs=airs)

    def rows(one):
        time = (59.0, 58.0, 10.0)[one.air_seed % 3]
        outcomes = {"correlation": 1.0 - 0.1 / time, "error": 0.1 / time}
        return made_study.record(one, [made_study.trial(time=time)], outcomes=outcomes)

    points = made_study.published(tmp_path, plan, made_study.records(plan, rows)).points()
    limits = {"time_s": (0, 60), "time_with_failures_s": (0, 60), "correlation": (-1, 1), "error": (0, inf)}
    for name, (least, most) in limits.items():
        mean, low, high = (points[name + end].to_list()[0] for end in ("", "_low", "_high"))
        if airs < 3:
            assert isnan(low)
            assert isnan(high)
            assert "at least 3 airs, there are 2" in points[f"{name}_words"][0]
        else:
            assert least < low < mean < high < most, name


def test_more_points_in_airs_of_the_same_seeds_make_no_narrower_interval(tmp_path):
    axes = {"speed": Axis("speed", "m/s", True), "algorithm": Axis("algorithm", "", True)}
    plan = made_study.plan(axes, [(s, a) for s in (0.2, 0.5, 1.0) for a in ("casting", "spiral")], airs=8)

    def rows(one):  # all that happens is the luck of the seed
        return made_study.record(one, [made_study.trial(0, (one.air_seed, k) in LUCKY) for k in range(3)])

    points = made_study.published(tmp_path, plan, made_study.records(plan, rows)).by_points
    alone = points.estimates["success"][0]
    assert alone is not None
    for pooled in (
        points.estimated(SUCCESS, ["all"])[0],
        points.estimated(SUCCESS, ["algorithm"])["spiral"],
    ):
        assert pooled[:3] == pytest.approx(alone[:3])
        assert pooled.airs == alone.airs == 8


@pytest.mark.parametrize("base", [{}, {"duration": 10}])
def test_the_longest_run_may_have_its_duration_from_an_axis(plan, base):
    plan.base = base
    durations = ["90 s", "2 min"] + ["1 min"] * (len(plan.requests) - 2)
    plan.requests = [
        request._replace(changes={"duration": duration})
        for request, duration in zip(plan.requests, durations, strict=True)
    ]
    assert tables.planned(plan).longest_s == 120.0
