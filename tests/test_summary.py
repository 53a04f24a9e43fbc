"""What a run says of itself when it ends: nothing that its figures do not tell, in result.json and in words."""

import json
from typing import Any

import fake_run
import numpy as np
import pytest

from taichi_plume.execution import result, summary
from taichi_plume.files.json_values import json_value
from taichi_plume.scoring import trials as scores
from taichi_plume.scoring.maps import MapScores

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

AREA = {"kind": "area", "low": [3, 0.5], "high": [3.8, 2.5]}
PLACED = {"kind": "positions", "positions": [[3.0, 1.0]], "heading_deg": 0}


def group(name: str, **keys: Any) -> dict[str, Any]:
    return {"name": name, "count": 1, "start": AREA, "algorithm": {"kind": "casting"}} | keys


def summary_of(sim: Any, status: str = "completed") -> tuple[dict[str, Any], dict[str, str]]:
    """What a run comes to, as read from its result.json, and the lines of its summary."""
    judge = MapScores(sim)
    sim.observers.append(judge.observer())
    if status == "completed":
        sim.run()
    content = result.result(sim, status, "", "cpu", judge)
    lines = summary.summary(content)
    assert len(dict(lines)) == len(lines), "no two lines of one name"
    assert "nan" not in str(lines).lower()
    return json.loads(json.dumps(json_value(content), allow_nan=False)), dict(lines)


def run(**changes: Any) -> tuple[dict[str, Any], dict[str, str]]:
    return summary_of(fake_run.simulation(fake_run.scenario(2, **{"duration": 9, **changes})))


RIVALS = [group("casters", trials=2), group("sweepers", trials=3, algorithm={"kind": "sweep"})]


def test_maps_of_rivals_are_scored_by_name():
    sim: Any = fake_run.simulation(fake_run.scenario(2, duration=11, robots=RIVALS, rivals=True))
    fake = sim.maps[0]
    half, off = fake.estimate, np.array([0.0, 2.0, 10.0, 20.0, 30.0])[:, None, None]
    fake.estimate = lambda: half() + off
    content, lines = summary_of(sim)
    one, other = content["maps"]
    assert {"mae_ppm", "per_trial", "mean_gas", "forecast"}.isdisjoint(one), "no mean over groups"
    casters, sweepers = one["groups"]
    assert (casters["name"], sweepers["name"]) == ("casters", "sweepers")
    estimate, truth = fake.estimate(), scores.true_gas(sim, fake.cell, fake.shape)
    errors = [np.nanmean(np.abs(trial - truth)) for trial in estimate]
    assert casters["per_trial"]["mae_ppm"] == pytest.approx(errors[:2], rel=1e-5)
    assert casters["mae_ppm"] == pytest.approx(np.mean(errors[:2]), rel=1e-5)
    assert sweepers["per_trial"]["mae_ppm"] == pytest.approx(errors[2:], rel=1e-5)
    assert sweepers["mae_ppm"] == pytest.approx(np.mean(errors[2:]), rel=1e-5)
    assert len(sweepers["mean_gas"]["per_trial_at_end"]["error_ppm"]) == 3
    assert sweepers["mean_gas"]["error_ppm"][-1] > casters["mean_gas"]["error_ppm"][-1] + 15.0
    assert [len(part["forecast"]["time_s"]) for part in other["groups"]] == [2, 2]
    assert f"at the end: error {casters['mae_ppm']:.3g} ppm" in lines["time series map, casters"]
    assert f"at the end: error {sweepers['mae_ppm']:.3g} ppm" in lines["time series map, sweepers"]
    assert "mean of 3 trials" in lines["inverse distance map, sweepers"]
    assert "one arena" not in lines


def test_groups_that_share_an_arena_are_reported():
    content, lines = run(robots=RIVALS)
    assert [one["shares_arena_with"] for one in content["groups"]] == [["sweepers"], ["casters"]]
    assert lines["one arena"] == (
        "casters, sweepers share the arena and the maps; add rivals: true to compare them; "
        "only the first 2 trials have all groups"
    )
    assert content["maps"][0]["made_by"] == ["casters", "sweepers"]
    assert "mae_ppm" in content["maps"][0]


@pytest.mark.parametrize(
    ("robots", "reported"),
    [
        ([group("a"), group("b")], False),
        ([group("a"), group("b", algorithm={"kind": "casting", "threshold_ppm": 9})], True),
        ([group("a")], False),
    ],
)
def test_only_those_that_differ_are_compared(robots, reported):
    _, lines = run(robots=robots, maps=[])
    assert ("one arena" in lines) == reported
    assert "maps" not in lines.get("one arena", "")


def test_trials_of_one_air_are_reported():
    content, lines = run()
    (team,) = content["groups"]
    assert (team["trials"], team["airs"], team["trials_differ_by"]) == (2, 1, "starts and chance")
    assert all(one["airs"] == 1 for one in team["summary"].values())
    assert team["summary"]["success_rate"]["n"] == 2
    assert "success 100 % (34 to 100 %, of 2 trials in one air)" in lines["team"]
    assert "only starts and what robots draw by chance differ" in lines["one air"]
    assert lines["one air"].endswith("nothing random is in the air itself: other seeds make the same")
    gusty = {"kind": "uniform", "velocity": [1, 0], "gusts": {}}
    _, lines = run(wind=gusty, obstacles=[], robots=[group("a", trials=2, start=PLACED)])
    assert "only what robots draw by chance differs" in lines["one air"]
    assert lines["one air"].endswith("intervals say nothing of other airs, which other seeds make")
    _, lines = run(robots=[group("a")])
    assert "one air" not in lines
    assert "success" not in lines["a"]


def test_trials_that_are_the_same_count_as_one():
    sim: Any = fake_run.simulation(fake_run.scenario(2, duration=9, robots=[group("a", trials=20, count=2)]))
    snapshot = sim.swarm.snapshot

    def same() -> dict[str, np.ndarray]:
        first = {name: np.asarray(values)[:2] for name, values in snapshot().items()}
        return {name: np.tile(values, (20, *[1] * (values.ndim - 1))) for name, values in first.items()}

    sim.swarm.snapshot = same
    content, lines = summary_of(sim)
    (one,) = content["groups"]
    assert one["trials_differ_by"] == "nothing"
    assert one["summary"]["success_rate"]["n"] == 1
    assert len(one["per_trial"]["success"]) == 20
    assert "success" not in lines["a"]
    assert "the 20 trials of a are identical to the bit" in lines["one trial"]
    assert "one air" not in lines


def test_all_failed_is_an_interval_too():
    _, lines = run(duration=5)
    assert lines["team"] == (
        "casting, 0 of 8 robots found a source, in 0 of 2 trials at least one; "
        "success 0 % (0 to 66 %, of 2 trials in one air)"
    )


LATER = {"kind": "eulerian", "sources": [{"position": [0.6, 1.5], "rate": 2e-5, "start": 20}]}


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"robots": [group("team", trials=2, reach=0)]}, "reach is 0"),
        ({"gas": LATER}, "no source had started"),
    ],
)
def test_nothing_is_claimed_where_nothing_could_be_found(changes, why):
    content, lines = run(**{"duration": 5, **changes})
    (team,) = content["groups"]
    assert team["no_search"] == why
    assert team["success_rate"] is None
    assert {one["n"] for one in team["summary"].values()} == {0}
    assert lines["team"] == f"casting, no search took place: {why}"
    assert ("from a source" in lines["time series map"]) == (why == "reach is 0")


def test_who_was_found_all_the_same_is_reported():
    """A source that has not started has a place, which robots may come to."""
    content, lines = run(gas=LATER)
    assert content["groups"][0]["no_search"] is None
    assert "2 of 8 robots found a source" in lines["team"]


def test_a_scenario_without_sources():
    sim: Any = fake_run.simulation(fake_run.scenario(2, duration=2))
    gas = {"kind": "playback", "file": "a.zarr"}
    sim.scenario = fake_run.scenario(2, duration=2, gas=gas)
    content, lines = summary_of(sim)
    assert lines["team"] == "casting, no search took place: there is no source"
    assert content["groups"][0]["per_trial"]["final_distance_m"] == [None, None]


def test_a_run_that_was_interrupted_claims_no_more_than_it_saw():
    sim: Any = fake_run.simulation(fake_run.scenario(2, duration=100, warm_up=5))
    content, lines = summary_of(sim, "interrupted")
    assert lines["team"] == "casting, no search took place: the robots had not started"
    assert content["maps"][0]["mean_gas"]["per_trial_at_end"] == {}
    assert lines["time series map"] == "no cell is known"
    for _ in range(80):
        sim.advance()
    content, _ = summary_of(sim, "interrupted")
    team = content["groups"][0]
    assert team["no_search"] is None
    assert team["summary"]["time_with_failures_s"]["mean"] == pytest.approx(3.0), "what it lasted, not 100 s"


def test_nobody_and_nothing():
    sim: Any = fake_run.simulation(fake_run.scenario(2, duration=1, robots=[], maps=[]))
    content, lines = summary_of(sim)
    assert (content["groups"], content["maps"]) == ([], [])
    assert set(lines) == {"fake-2d", "time", "grid", "flow", "gas"}


def test_numbers_of_flow_and_gas_have_the_names_of_the_report():
    sim: Any = fake_run.simulation(fake_run.scenario(2, duration=1, robots=[], maps=[]))
    sim.run()
    content = result.result(sim, "completed", "", "cpu") | {"flow": {"eddy_diffusivity_m2_per_s": 0.00416}}
    lines = dict(summary.summary(content))
    assert lines["flow"] == "eddy diffusivity [m²/s] 0.00416"
    assert lines["gas"].startswith("2000 g emitted by the sources, 500 g still in the room")
    assert lines["gas"].endswith("of the incoming mass unaccounted for")


def test_maps_of_one_kind_are_distinguished():
    _, lines = run(maps=[{"kind": "time_series"}, {"kind": "gmrf"}, {"kind": "time_series", "alpha": 0.5}])
    assert {"time series map (maps[0])", "gmrf map", "time series map (maps[2])"} <= set(lines)


@pytest.mark.parametrize(
    ("pushes", "pinned", "expected"), [(0, 0.0, None), (2, 0.0, "16 times"), (1, 1.5, "12 s")]
)
def test_robots_pushed_by_obstacles_are_counted(pushes, pinned, expected):
    sim: Any = fake_run.simulation(fake_run.scenario(2, duration=2))
    of_old, count = sim.swarm.snapshot, sim.swarm.count
    more = {"pushes": np.full(count, pushes, np.int32), "pinned_s": np.full(count, pinned, np.float32)}
    sim.swarm.snapshot = lambda: of_old() | more
    content, lines = summary_of(sim)
    (group,) = content["groups"]
    assert sum(group["per_trial"]["pushes"]) == count * pushes
    assert sum(group["per_trial"]["pinned_s"]) == count * pinned
    line = lines.get(f"{group['name']} pushed")
    assert line is None if expected is None else expected in line
