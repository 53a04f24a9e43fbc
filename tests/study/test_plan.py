"""Plans of studies: every run once, ids that depend on what decides a run, and every error reported before a run."""

import json
import subprocess
import sys
from itertools import product
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.stats import sobol_indices
from small_study import ROOM, SPEED, write

from taichi_plume.scenario.changes import changed
from taichi_plume.scenario.loading import scenario_of
from taichi_plume.studies.air_plan import shared_airs
from taichi_plume.studies.axes import Level, Levels, points
from taichi_plume.studies.axis_values import resolve
from taichi_plume.studies.ids import Digests
from taichi_plume.studies.indices import numbers
from taichi_plume.studies.plan import SEARCH_STEP, columns, load_plan, read_study
from taichi_plume.studies.study_keys import canonical

SEARCH = {
    "variants": {
        "casting": {"robots.0.algorithm": {"kind": "casting", "threshold_ppm": 5}},
        "spiral": {"robots[0].algorithm": {"kind": "spiral"}},
    }
}
HEIGHT = {"key": "robots.0.sensors.gas.height", "low": "5 cm", "high": 0.3}
RATE = {"key": "gas.sources.0.rate", "low": "1 mg/s", "high": "100 mg/s", "count": 3, "spacing": "log"}


def test_all_combinations_are_there_the_last_axis_changes_fastest(tmp_path):
    plan = load_plan(
        write(tmp_path, axes={"speed": SPEED, "rate": RATE, "search": SEARCH}, airs=2, searches=3)
    )
    expected = product([0.2, 0.4], [1e-6, 1e-5, 1e-4], ["casting", "spiral"])
    points = {one.point: tuple(one.values.values()) for one in plan.requests}
    assert list(points.values()) == [pytest.approx(one) for one in expected]
    assert [one.number for one in plan.requests] == list(range(2 * 3 * 2 * 6))
    assert [axis.unit for axis in plan.axes] == ["m/s", "kg/s", ""]
    assert all(axis.partition for axis in plan.axes)
    assert len({one.run for one in plan.requests}) == len(plan.requests)
    first = [one for one in plan.requests if one.point == 0]
    assert [one.air_seed for one in first] == [3, 3, 3, 4, 4, 4]
    assert [one.seed for one in first] == [3 + k + SEARCH_STEP * j for k in (0, 1) for j in (0, 1, 2)]
    for one in plan.requests:
        scenario = scenario_of(plan.base, one.changes)
        assert (scenario.seed, scenario.seed_of_air) == (one.seed, one.air_seed)
        assert scenario.robots[0].algorithm.kind == one.values["search"]
        assert scenario.sources[0][1].rate == pytest.approx(one.values["rate"])  # type: ignore[union-attr]
    assert "air_seed" not in first[0].changes


def test_sampled_axes_spread_over_their_ranges_and_go_with_all_of_the_grid(tmp_path):
    rate = {key: value for key, value in RATE.items() if key != "count"}
    axes = {"height": HEIGHT, "speed": SPEED, "rate": rate}
    for kind in ("sobol", "latin"):
        plan = load_plan(write(tmp_path, axes=axes, sampling={"kind": kind, "count": 16, "seed": 4}, airs=1))
        assert len(plan.requests) == 32
        assert [list(one.values) for one in plan.requests] == [["height", "speed", "rate"]] * 32
        assert [axis.partition for axis in plan.axes] == [False, True, False]
        drawn = [(one.values["height"], one.values["rate"]) for one in plan.requests]
        assert drawn[:16] == drawn[16:]
        heights, rates = zip(*drawn[:16], strict=True)
        # one in each sixteenth of the range, of the rate in each of its logarithm
        assert sorted(int(16 * (h - 0.05) / 0.25) for h in heights) == list(range(16))
        assert sorted(int(8 * (6 + np.log10(r))) for r in rates) == list(range(16))
    other = load_plan(write(tmp_path, axes=axes, sampling={"kind": "latin", "count": 16, "seed": 5}))
    assert [one.values["height"] for one in other.requests[:5]] != heights[:5]


def test_more_points_of_a_sobol_sequence_keep_those_that_there_were(tmp_path):
    few, more = (
        load_plan(write(tmp_path, axes={"h": HEIGHT}, sampling={"kind": "sobol", "count": count}))
        for count in (8, 16)
    )
    assert {one.run for one in few.requests} < {one.run for one in more.requests}


def test_a_sensitivity_study_has_the_matrices_of_saltelli(tmp_path):
    """The indices of a linear function are known: its terms' shares of the variance, first order and total alike."""
    speed = {"key": "wind.openings.0.speed", "low": 0.1, "high": 0.3}
    depth = {"key": "domain.depth", "low": 0.5, "high": 1.5}
    axes = {"height": {**HEIGHT, "high": 0.25}, "speed": speed, "depth": depth}
    study = read_study(write(tmp_path, kind="sensitivity", samples=512, axes=axes, airs=1))
    y = np.array(
        [np.dot([1, 2, 0.1], list(one.values.values())) for one in points(study, resolve(study, ROOM, ""))]
    )
    assert len(y) == 512 * 5
    a, b, ab = (y[points] for points in numbers(512, 3))
    indices = sobol_indices(func={"f_A": a[None], "f_B": b[None], "f_AB": ab[:, None]}, n=512)
    variances = np.array([0.2, 2 * 0.2, 0.1]) ** 2
    assert indices.first_order.ravel() == pytest.approx(variances / variances.sum(), abs=0.02)
    assert indices.total_order.ravel() == pytest.approx(variances / variances.sum(), abs=0.02)
    few = load_plan(write(tmp_path, kind="sensitivity", samples=4, axes=axes, airs=1))
    assert [one.point for one in few.requests] == list(range(4 * 5))


def test_keys_share_a_value_and_values_may_be_lists_and_sections(tmp_path):
    both = {"keys": ["domain.spacing", "maps.0.cell"], "values": ["5 cm", 0.1]}
    place = {"key": "gas.sources.0.position", "values": [[0.3, 0.5], [0.4, 0.5]]}
    early = {"key": "stop_early", "values": [True, False]}
    plan = load_plan(write(tmp_path, axes={"dx": both, "place": place, "early": early}, airs=1))
    assert {one.values["dx"] for one in plan.requests} == {0.05, 0.1}
    assert {one.values["place"] for one in plan.requests} == {"[0.3, 0.5]", "[0.4, 0.5]"}
    assert {one.values["early"] for one in plan.requests} == {True, False}
    assert [axis.unit for axis in plan.axes] == ["m", "", ""]
    for one in plan.requests:
        scenario = scenario_of(plan.base, one.changes)
        assert scenario.domain.spacing == scenario.maps[0].cell == one.values["dx"]
        assert json.dumps(scenario.sources[0][1].position) == one.values["place"]


@pytest.mark.parametrize(
    ("values", "folders"),
    [
        ([range(65), range(2)], [False, True]),
        ([range(2), range(40), range(26)], [True, True, False]),  # 2,080 folders would be too many
        ([["b" * 101, "c"], [1]], [False, False]),
        ([["a", "A"]], [False]),  # a single folder on macOS and Windows
    ],
)
def test_folders_are_made_of_axes_with_few_short_values(values, folders):
    axes = [Levels(f"axis{n}", "", [Level(value, {}) for value in each]) for n, each in enumerate(values)]
    assert [axis.partition for axis in columns(axes)] == folders


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(random=st.randoms(use_true_random=False))
def test_ids_do_not_depend_on_the_order_of_keys(tmp_path, random):
    def turned(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: turned(value[key]) for key in random.sample(sorted(value), len(value))}
        return [turned(one) for one in value] if isinstance(value, list) else value

    axes = {"speed": SPEED, "search": SEARCH, "height": HEIGHT | {"count": 2}}
    ids = [
        {(one.run, one.air, one.structure, one.seed, one.air_seed) for one in load_plan(file).requests}
        for file in (write(tmp_path, axes=axes), write(tmp_path, turned(ROOM), axes=turned(axes)))
    ]
    assert ids[0] == ids[1]
    assert len(ids[0]) == 40


def test_axes_of_seeds_are_runs_of_one_point(tmp_path):
    axes = {"speed": SPEED, "seed": {"key": "seed", "values": [7, 8, "9"]}}
    plan = load_plan(write(tmp_path, axes=axes))
    assert [(one.point, one.seed, one.air_seed) for one in plan.requests] == [
        (point, seed, seed) for point in (0, 1) for seed in (7, 8, 9)
    ]
    assert [axis.partition for axis in plan.axes] == [True, False]
    plan = load_plan(
        write(tmp_path, axes={"eddies": {"key": "air_seed", "values": [7, 8]}} | {"speed": SPEED})
    )
    assert {(one.seed, one.air_seed) for one in plan.requests} == {(3, 7), (3, 8)}


# ---------------------------------------------------------------- ids


def one_run(tmp_path, room: dict[str, Any], **changes: Any):
    """A run of the room with a few keys changed."""
    axis = {"variants": {"a": changes or {"duration": room["duration"]}}}
    airs = {} if {"seed", "air_seed"} & changes.keys() else {"airs": 1}
    return load_plan(write(tmp_path, room, axes={"x": axis}, **airs)).requests[0]


@pytest.mark.parametrize(
    "changes",
    [
        {"duration": "4 s"},
        {"wind.openings.0.speed": "50 cm/s"},
        {"gas.sources.0.rate": 1e-6},
        {"domain.spacing": "100 mm"},
        {"tick": "100 ms"},
        {"name": "other"},
        {"recording": {"rate": 1}},
        {"checkpoint": None},
        {"fields": {"rate": 1}},
        {"air_seed": 3},
        {"robots.0.body": {}},
        {"robots": [{key: ROOM["robots"][0][key] for key in reversed(ROOM["robots"][0])}]},
    ],
)
def test_ids_do_not_depend_on_what_decides_nothing(tmp_path, changes):
    same, other = one_run(tmp_path, ROOM), one_run(tmp_path, ROOM, **changes)
    assert (same.run, same.air) == (other.run, other.air)


@pytest.mark.parametrize(
    ("changes", "air"),
    [
        ({"seed": 4}, True),
        ({"air_seed": 4}, True),
        ({"seed": 4, "air_seed": 3}, False),
        ({"duration": 5}, True),
        ({"wind.openings.0.speed": 0.51}, True),
        ({"gas.sources.0.rate": 2e-6}, True),
        ({"obstacles": [{"kind": "box", "center": [1, 0.5], "size": [0.2, 0.2]}]}, True),
        ({"robots.0.count": 1}, False),
        ({"robots.0.algorithm": {"kind": "spiral"}}, False),
        ({"maps": []}, False),
        ({"stop_early": False}, False),
        ({"robots.0.wake": True, "robots.0.body.radius": 0.1}, True),
    ],
)
def test_ids_depend_on_what_decides_a_run_or_its_air(tmp_path, changes, air):
    old, new = one_run(tmp_path, ROOM), one_run(tmp_path, ROOM, **changes)
    assert old.run != new.run
    assert (old.air != new.air) == air


def test_runs_that_are_shown_less_than_their_air_are_others(tmp_path):
    puffs = ROOM | {"gas": ROOM["gas"] | {"kind": "puffs"}}
    for room, others in ((puffs, True), (ROOM, False)):
        exact, always = (
            load_plan(write(tmp_path, room, share_air=share, airs=1)) for share in ("exact", "always")
        )
        assert [one.air for one in exact.requests] == [one.air for one in always.requests]
        assert ([one.run for one in exact.requests] != [one.run for one in always.requests]) == others
        last = exact.requests[-1:]  # the only one that is left in its air
        assert not shared_airs(exact, last)
        assert shared_airs(always, last) == ({last[0].air} if others else set())


def test_airs_differ_only_where_something_is_drawn(tmp_path):
    still = {"kind": "inlet", "face": "x-", "speed": 0.5}
    calm = ROOM | {"wind": {"kind": "cfd", "openings": [still, {"kind": "outlet", "face": "x+"}]}}
    for room, airs in ((ROOM, 3), (calm, 1)):
        plan = load_plan(
            write(tmp_path, room, axes={"n": {"key": "robots.0.count", "values": [1, 2]}}, airs=3)
        )
        assert len({one.air for one in plan.requests}) == airs
        assert len({one.run for one in plan.requests}) == 6
        assert {one.air_by_chance for one in plan.requests} == {airs > 1}


def test_robots_with_a_wake_have_an_air_of_their_own(tmp_path):
    robot = ROOM["robots"][0] | {"wake": True, "body": {"radius": 0.1}}
    room = ROOM | {"robots": [robot]}
    plan = load_plan(write(tmp_path, room, axes={"speed": SPEED, "search": SEARCH}, airs=2, searches=2))
    assert len({one.air for one in plan.requests}) == len(plan.requests) == 16


def test_runs_of_a_structure_differ_in_numbers_alone(tmp_path):
    axes = {
        "speed": SPEED,
        "search": SEARCH,
        "dx": {"key": "domain.spacing", "values": [0.1, 0.05]},
        "n": {"key": "robots.0.count", "values": [1, 2]},
    }
    plan = load_plan(write(tmp_path, axes=axes, airs=2))
    structures = {tuple(one.values[name] for name in ("search", "n")): one.structure for one in plan.requests}
    assert len({one.structure for one in plan.requests}) == len(set(structures.values())) == len(structures)


def test_a_file_counts_by_its_content(tmp_path):
    code = "class Mine:\n    def act(self, readings):\n        return 0.1, 0.0\n"
    (tmp_path / "a.py").write_text(code)
    (tmp_path / "b.py").write_text(code)
    own = {"robots.0.algorithm": {"kind": "own", "file": "a.py", "parameters": {"gain": 1.5}}}
    first = one_run(tmp_path, ROOM, **own)
    renamed = one_run(tmp_path, ROOM, **own, name="x")
    assert first.run == renamed.run
    own["robots.0.algorithm"] = own["robots.0.algorithm"] | {"file": "b.py"}
    assert one_run(tmp_path, ROOM, **own).run == first.run
    (tmp_path / "b.py").write_text(code + "# more\n")
    other = one_run(tmp_path, ROOM, **own)
    assert other.run != first.run
    assert other.air == first.air
    assert other.structure != first.structure  # a worker that has read the file keeps what it held


def test_a_film_counts_by_what_its_chunks_hold(tmp_path):
    film = tmp_path / "fields.zarr"
    film.mkdir()
    (film / "zarr.json").write_text("{}")
    reported = []
    for content in (b"0.2", b"0.4"):
        (film / "c0").write_bytes(content)
        reported.append(Digests(tmp_path)._of(film))
    assert reported[0] != reported[1]


def test_a_plan_is_the_same_in_another_process_and_ids_with_axes_in_another_order(tmp_path):
    axes = {"speed": SPEED, "height": HEIGHT, "search": SEARCH}
    sampling = {"kind": "sobol", "count": 4}
    here = load_plan(write(tmp_path, axes=axes, sampling=sampling, airs=2)).requests
    code = f"""
import sys
from pathlib import Path
from taichi_plume.studies.ids import Digests
from taichi_plume.studies.plan import load_plan
for one in load_plan(Path({str(tmp_path / "study.yaml")!r})).requests:
    print(one)
assert not {{"taichi", "pandas", "distributed", "matplotlib", "zarr"}} & set(sys.modules)
"""
    there = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert there.stdout.splitlines() == [str(one) for one in here]
    turned = dict(reversed(axes.items()))
    other = load_plan(write(tmp_path, axes=turned, sampling=sampling, airs=2)).requests
    assert [one.run for one in here] != [one.run for one in other]
    ids = [{(one.run, one.air, one.structure, one.seed) for one in plan} for plan in (here, other)]
    assert ids[0] == ids[1]


# ---------------------------------------------------------------- changes


def test_what_aliases_share_changes_in_one_place_alone():
    text = """
    a: &part {list: [1, {x: 1}]}
    b: *part
    """
    data = yaml.safe_load(text)
    section = {"y": 1}
    new = changed(data, {"a.list.1.x": 2, "b.more": section, "b.more.y": 5, "a.list.0": 9})
    assert new == {"a": {"list": [9, {"x": 2}]}, "b": {"list": [1, {"x": 1}], "more": {"y": 5}}}
    assert section == {"y": 1}
    assert data == yaml.safe_load(text)


def test_a_path_has_one_way_of_writing():
    assert canonical("robots.0.count") == canonical(" robots[0].count") == canonical("robots[00].count")
