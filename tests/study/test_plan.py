"""Plans of studies: every run once, ids that depend on what decides a run, and every fault told before the first."""

from itertools import product

import pytest
from small_study import SPEED, write

from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.study.plan import SEARCH_STEP, load_plan
from taichi_plume.study.scenarios import scenario_of

SEARCH = {
    "variants": {
        "casting": {"robots.0.algorithm": {"kind": "casting", "threshold_ppm": 5}},
        "spiral": {"robots[0].algorithm": {"kind": "spiral"}},
    }
}
HEIGHT = {"key": "robots.0.sensors.gas.height", "low": "5 cm", "high": 0.3}
RATE = {"key": "gas.sources.0.rate", "low": "1 mg/s", "high": "100 mg/s", "count": 3, "spacing": "log"}


def faults(file) -> list[str]:
    """Without the file's name, which each has to begin with."""
    with pytest.raises(ScenarioError) as caught:
        load_plan(file)
    lines = caught.value.faults
    assert all(line.startswith(f"{file}: ") for line in lines)
    return [line.removeprefix(f"{file}: ") for line in lines]


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
