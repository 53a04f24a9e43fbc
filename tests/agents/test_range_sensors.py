"""Range sensors: distances to walls, obstacles and robots, against closed forms, and their limits and noise."""

from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from taichi_plume.assembly.assemble import assemble
from taichi_plume.cli import run
from taichi_plume.scenario.loading import ScenarioError, scenario_from

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

SIZE = (4.0, 3.0)
BEARINGS = (90.0, 45.0, 0.0, -120.0)
RAY = {"bearings_deg": BEARINGS, "field_of_view_deg": 0, "min_range": 0, "max_range": 50, "noise": 0}
MANY = 60
RADIUS = 0.05


def room(ranges, size=SIZE, start=None, count=1, trials=MANY, **keys):
    """Robots at many places, looking anywhere."""
    wind: dict[str, Any] = {"kind": "uniform", "velocity": [0.5] + [0.0] * (len(size) - 1)}
    gas: dict[str, Any] = {"kind": "gaussian_plume", "intensity": 0.1}
    if "obstacles" in keys:
        wind, gas = {"kind": "synthetic", "speed": 0.05}, {"kind": "eulerian"}
    gas["sources"] = [{"position": [0.2, 0.2, 0.2][: len(size)], "rate": 1e-6}]
    return {
        "duration": 1.0,
        "domain": {"size": list(size), "spacing": 0.05},
        "wind": wind,
        "gas": gas,
        "robots": [
            {
                "count": count,
                "trials": trials,
                "start": start or {"kind": "area", "low": [0.3, 0.3], "high": [3.7, 2.7]},
                "reach": 0,
                "body": {"radius": RADIUS, "height": 0.1},
                "algorithm": {"kind": "casting", "speed": 0},
                "sensors": {"range": ranges},
            }
        ],
    } | keys


def measured(scenario, ticks=1):
    """Positions, headings and readings (ticks, robots, sensors) [m] of robots that stand."""
    sim = assemble(scenario_from(scenario))
    readings = []
    for tick in range(1, ticks + 1):
        sim.sensors.measure(sim.gas, sim.wind, tick, 0.1 * tick)
        now = sim.swarm.snapshot()
        readings.append(np.stack([now[key] for key in now if key.startswith("range_")], axis=1))
    return now["position"].astype(float), now["heading"].astype(float), np.array(readings)


def rays(place, heading, bearings):
    """Rims (robots, sensors, 2) and unit vectors of rays in the middle of each sensor's cone."""
    angle = heading[:, None] + np.radians(bearings)
    e = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return place[:, None] + RADIUS * e, e


def to_walls(x, e):
    with np.errstate(divide="ignore"):
        return np.where(e > 0, (np.array(SIZE) - x) / e, -x / e).min(axis=-1)


def to_disc(x, e, center, radius):
    """Length of rays to a disc; infinite past it."""
    to = np.array(center) - x
    along = (to * e).sum(axis=-1)
    inside = radius**2 - ((to**2).sum(axis=-1) - along**2)
    return np.where((along > 0) & (inside > 0), along - np.sqrt(np.maximum(inside, 0)), np.inf)


@pytest.mark.parametrize("size", [SIZE, (*SIZE, 0.5)])
def test_rays_end_at_walls_and_trials_do_not_see_each_other(size):
    place, heading, (read,) = measured(room(RAY, size))
    np.testing.assert_allclose(read, to_walls(*rays(place, heading, BEARINGS)), rtol=1e-4, atol=1e-4)


def test_rays_end_at_obstacles_within_half_a_cell():
    disc = {"kind": "cylinder", "center": [2.0, 1.5], "radius": 0.4}
    place, heading, (read,) = measured(room(RAY, obstacles=[disc]))
    x, e = rays(place, heading, BEARINGS)
    wall, obstacle = to_walls(x, e), to_disc(x, e, disc["center"], disc["radius"])
    to = np.array(disc["center"]) - x
    edge = np.abs(np.abs(to[..., 0] * e[..., 1] - to[..., 1] * e[..., 0]) - disc["radius"]) < 0.05
    off = np.abs(read - np.minimum(wall, obstacle))[~edge]
    assert off.max() < 0.025
    assert (obstacle < wall).sum() > 10


@pytest.mark.parametrize(("height", "seen"), [(0.1, True), (0.3, False)])
def test_in_three_dimensions_rays_pass_over_low_boxes(height, seen):
    box = {"kind": "box", "center": [2.0, 1.5, 0.1], "size": [0.4, 3.0, 0.2]}
    start = {"kind": "positions", "positions": [[1.0, 1.5]], "heading_deg": 0}
    look = RAY | {"bearings_deg": [0], "height": height}
    *_, read = measured(room(look, (*SIZE, 0.5), start, trials=1, obstacles=[box]))
    assert read.item() == pytest.approx((1.8 if seen else 4.0) - 1.0 - RADIUS, abs=0.025)


def test_a_cone_finds_the_nearest_surface_within():
    """Against rays a twentieth of a degree apart; the wall between two rays 5 degrees apart is nearer by 0.1 %."""
    cone = RAY | {"field_of_view_deg": 60}
    place, heading, (read,) = measured(room(cone))
    x, _ = rays(place, heading, BEARINGS)
    fine = [
        to_walls(x, rays(place, heading, np.add(BEARINGS, angle))[1]) for angle in np.linspace(-30, 30, 1201)
    ]
    nearest = np.min(fine, axis=0)
    assert (read >= nearest * (1 - 1e-4)).all()
    np.testing.assert_allclose(read, nearest, rtol=2e-3)


@pytest.mark.parametrize(("y", "seen"), [(1.243, True), (2.7, False), (0.6, True)])
def test_other_robots_of_the_trial_are_found_between_rays(y, seen):
    """A small robot 1 m or more away fits between two rays, 5 degrees apart; another is outside the cone."""
    places = [[1.0, 1.5], [3.0, y]]
    start = {"kind": "positions", "positions": places, "heading_deg": 0}
    look = RAY | {"bearings_deg": [0], "field_of_view_deg": 50}
    scenario = room(look, start=start, count=2, trials=1)
    *_, (read,) = measured(scenario)
    rim = np.array([1.0 + RADIUS, 1.5])
    distance = np.hypot(*(np.array(places[1]) - rim)) - RADIUS
    assert read[0, 0] == pytest.approx(distance if seen else 4.0 - rim[0], rel=1e-4)


def test_readings_have_noise_and_limits():
    start = {"kind": "positions", "positions": [[1.0, 1.5]], "heading_deg": 180}
    look = {
        "bearings_deg": [0, 180, 90],
        "min_range": 0.96,
        "max_range": 2.5,
        "noise": 0.02,
        "field_of_view_deg": 0,
    }
    *_, read = measured(room(look, start=start, trials=1), 400)
    near, far, across = read[:, 0].T
    assert near.min() == pytest.approx(0.96)  # true 0.95 m
    assert (far == 2.5).all()  # true 2.95 m
    assert across.mean() == pytest.approx(1.45, abs=0.004)
    assert across.std() == pytest.approx(0.02, rel=0.15)
    assert abs(np.corrcoef(across[1:], across[:-1])[0, 1]) < 0.2


def test_tables_and_own_algorithms_have_the_readings(tmp_path):
    (tmp_path / "own.py").write_text(
        "class Look:\n"
        "    DECISIONS = (('ahead', 'm', 'range ahead'),)\n"
        "    ahead = None\n"
        "    def act(self, robots):\n"
        "        assert robots.ranges.shape == (2, 2)\n"
        "        self.ahead = robots.ranges[:, 1].copy()\n"
    )
    (tmp_path / "s.yaml").write_text(
        "duration: 1\n"
        "domain: {size: [2, 1], spacing: 0.1}\n"
        "wind: {kind: uniform, velocity: [0.1, 0]}\n"
        "gas: {kind: gaussian_plume, intensity: 0.1, sources: [{position: [0.1, 0.1], rate: 1 mg/s}]}\n"
        "robots:\n"
        "  - {name: a, count: 2, start: {kind: line, begin: [1, 0.3], end: [1, 0.7], heading_deg: 0},\n"
        "     body: {radius: 0.05}, algorithm: {kind: own, file: own.py},\n"
        "     sensors: {range: {bearings_deg: [180, 0], field_of_view_deg: 0, noise: 0}}}\n"
        "  - {name: blind, count: 1, start: {kind: positions, positions: [[1.5, 0.1]]}, body: {radius: 0.05},\n"
        "     algorithm: {kind: random_walk}}\n"
    )
    command = [str(tmp_path / "s.yaml"), "--out", str(tmp_path / "run"), "--quiet", "--allow-code"]
    assert run.main(command) == 0
    table = pq.read_table(tmp_path / "run/robots.parquet").to_pandas()
    last = table[table["t"] == table["t"].max()]
    mine = last[last["group"] == "a"]
    np.testing.assert_allclose(mine[["range_0_m", "range_1_m"]], 0.95, atol=1e-3)
    np.testing.assert_allclose(mine["ahead"], 0.95, atol=1e-3)
    assert last[last["group"] == "blind"][["range_0_m", "range_1_m"]].isna().all(axis=None)


def test_limits_in_the_wrong_order_are_refused():
    with pytest.raises(ScenarioError, match="min_range: 7 m is not below max_range, 6 m"):
        scenario_from(room({"min_range": 7}))
