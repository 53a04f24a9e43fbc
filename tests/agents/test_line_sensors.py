"""A laser reads the integral of the field along its beam: against closed forms, SciPy and finer sums."""

import json

import numpy as np
import pytest
from robots import Bench
from scipy.integrate import quad
from scipy.special import erf

from taichi_plume.agents.line_sensors import Surroundings
from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load
from taichi_plume.grid.fields import ppm_at
from taichi_plume.scenario.loading import scenario_from
from taichi_plume.scenario.species import SPECIES

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

EXACT = {"kind": "tdlas", "noise_ppm_m": 0, "detection_limit_ppm_m": 0, "rise_time": 0, "decay_time": 0}
METHANE = SPECIES["methane"].ppm_per_density
MANY = 60


def room(gas, size, sensor=EXACT, **keys):
    """Robots at many places, looking anywhere."""
    low, high = [0.3, 0.3], [size[0] - 0.3, size[1] - 0.3]
    return {
        "duration": 4.0,
        "domain": {"size": list(size), "spacing": 0.1},
        "wind": {"kind": "uniform", "velocity": [0.5] + [0.0] * (len(size) - 1)},
        "gas": {"species": "methane"} | gas,
        "robots": [
            {
                "count": 1,
                "trials": MANY,
                "start": {"kind": "area", "low": low, "high": high},
                "body": {"radius": 0.05},
                "algorithm": {"kind": "casting", "speed": 0},
                "sensors": {"gas": sensor},
            }
        ],
    } | keys


def looked(scenario, t=0.0, steps=0):
    """The simulation after some steps, and of each robot once measured: place, unit vector, reading, beam [m], mean."""
    sim = assemble(scenario_from(scenario))
    for _ in range(steps):
        sim.advance()
    sim.sensors.measure(sim.gas, sim.wind, 1, t or sim.t)
    now = sim.swarm.snapshot()
    sensor = scenario["robots"][0]["sensors"]["gas"]
    angle = now["heading"] + np.radians(sensor.get("bearing_deg", 0.0))
    tilt = np.radians(sensor.get("tilt_deg", 0.0))
    e, x = np.stack([np.cos(angle), np.sin(angle)], axis=1), now["position"].astype(float)
    if len(scenario["domain"]["size"]) == 3:
        e = np.column_stack([np.cos(tilt) * e, np.full(MANY, np.sin(tilt))])
        x = np.column_stack([x, np.full(MANY, sensor.get("height", 0.1))])
    return sim, x, e, now["reading_ppm"], sim.sensors.noses[0].length.to_numpy(), now["true_ppm"]


def to_the_walls(x, e, size):
    """How far rays get in a box."""
    with np.errstate(divide="ignore"):
        ways = np.where(e > 0, (np.array(size) - x) / e, np.where(e < 0, -x / e, np.inf))
    return ways.min(axis=1)


def assert_integral(sim, x, e, read, length, least):
    """To a percent, against points 1 mm apart of the field as all see it, where the integral is above `least`."""
    true = np.empty(MANY)
    for n in range(MANY):
        s = np.arange(0.0005, length[n], 0.001)
        true[n] = ppm_at(sim.gas, x[n] + s[:, None] * e[n], sim.t)[:, 0].sum() * 0.001
    some = true > least(true)
    assert some.sum() > 10
    np.testing.assert_allclose(read[some], true[some], rtol=0.01)


def test_a_gaussian_plume_is_integrated_to_a_percent():
    """At any angle, also along its axis, where it begins with a jump; robots that stand keep their lasers on target."""
    size, rate, speed, radius, intensity = (6.0, 4.0), 10e-6, 0.5, 0.02, 0.1
    source = {"position": [1.5, 2.0], "rate": rate, "radius": radius}
    gas = {"kind": "gaussian_plume", "intensity": intensity, "sources": [source]}
    sim, x, e, read, length, mean = looked(room(gas, size))

    def ppm(p):
        s = radius + intensity * max(p[0] - 1.5, 0.0)
        across = np.exp(-((p[1] - 2.0) ** 2) / (2 * s**2)) / (np.sqrt(2 * np.pi) * s)
        return METHANE * rate / speed * across if p[0] > 1.5 else 0.0

    np.testing.assert_allclose(length, to_the_walls(x, e, size), rtol=1e-4)
    true = np.zeros(MANY)
    for n in range(MANY):
        marks = [(1.5 - x[n, 0]) / e[n, 0], (2.0 - x[n, 1]) / e[n, 1]]
        marks = [one for one in marks if 0 < one < length[n]]
        true[n] = quad(lambda s, n=n: ppm(x[n] + s * e[n]), 0.0, length[n], points=marks or None, limit=400)[
            0
        ]
    some = true > 0.1
    assert some.sum() > 15
    np.testing.assert_allclose(read[some], true[some], rtol=0.01)
    assert (read[~some] < 0.11).all()
    np.testing.assert_allclose(mean * length, read, rtol=1e-4, atol=1e-6)
    before = sim.swarm.snapshot()
    sim.run()
    for name in ("heading", "position"):
        np.testing.assert_array_equal(sim.swarm.snapshot()[name], before[name])


def test_a_puff_in_3d_is_integrated_to_a_percent():
    """Along a line at distance d from a Gaussian of standard deviation s: the Gaussian of d, the erf of both ends."""
    size, mass, radius, place = (3.0, 2.0, 1.0), 1e-4, 0.05, np.array([1.6, 1.0, 0.5])
    release = {"position": place.tolist(), "mass": mass, "radius": radius}
    gas = {"kind": "gaussian_puff", "diffusivity": 1e-9, "releases": [release], "walls": []}
    still = {"kind": "uniform", "velocity": [1e-6, 0.0, 0.0]}
    sensor = EXACT | {"height": 0.4, "tilt_deg": 5.0, "bearing_deg": 40.0}
    _, x, e, read, length, _ = looked(room(gas, size, sensor, wind=still))
    np.testing.assert_allclose(length, to_the_walls(x, e, size), rtol=1e-4)
    along = ((place - x) * e).sum(axis=1)
    off = np.linalg.norm(place - x - along[:, None] * e, axis=1)
    profile = mass / (2 * np.pi * radius**2) * np.exp(-(off**2) / (2 * radius**2))
    ends = (erf((length - along) / (np.sqrt(2) * radius)) + erf(along / (np.sqrt(2) * radius))) / 2
    true = METHANE * profile * ends
    some = true > 1e-4 * METHANE * mass / (2 * np.pi * radius**2)
    assert some.sum() > 4
    np.testing.assert_allclose(read[some], true[some], rtol=0.01)


def test_puffs_are_integrated_to_a_percent():
    source = {"position": [0.6, 1.0], "rate": 1e-5}
    gas = {"kind": "puffs", "sources": [source], "release_rate": 20.0, "handover": False}
    sim, x, e, read, length, _ = looked(room(gas, (3.0, 2.0)), steps=30)
    assert_integral(sim, x, e, read, length, lambda true: 0.01 * true.max())


def test_a_computed_field_is_integrated_to_a_percent_up_to_obstacles():
    """Against the mean of points 1 mm apart of the field as all see it, up to a box, a pillar or one that walks."""
    size, low, high = (4.0, 3.0), np.array([2.0, 0.9]), np.array([2.5, 2.0])
    box = {"kind": "box", "center": (0.5 * (low + high)).tolist(), "size": (high - low).tolist()}
    round_ones = ((1.2, 2.2), 0.4), ((3.3, 1.4), 0.35)
    pillar, walker = ({"kind": "cylinder", "center": at, "radius": radius} for at, radius in round_ones)
    walker |= {"motion": {"path": [[9, 3.3, 1.4]]}}
    gas = {"kind": "eulerian", "sources": [{"position": [0.8, 1.4], "rate": 1e-5, "start": -3.0}]}
    wind = {"kind": "synthetic", "speed": 0.5}
    scenario = room(gas, size, obstacles=[box, pillar, walker], wind=wind, warm_up=3.0)
    sim, x, e, read, length, _ = looked(scenario, steps=35)
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - x) / e, (high - x) / e
    near, far = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
    ends, hits = to_the_walls(x, e, size), np.zeros((3, MANY), bool)
    ways, clear = [np.where((near < far) & (near > 0), near, np.inf)], np.ones(MANY, bool)
    for place, radius in round_ones:
        to = np.array(place) - x
        along = (to * e).sum(axis=1)
        aside = (to**2).sum(axis=1) - along**2
        under = radius**2 - aside
        clear &= (aside > (radius + 0.1) ** 2) | (along < 0)
        ways.append(np.where((under > 0) & (along > 0), along - np.sqrt(np.maximum(under, 0)), np.inf))
    for n, way in enumerate(ways):
        hits[n], ends = way < ends, np.minimum(ends, way)
    assert (hits[0] & clear).sum() > 3
    assert hits[1:].sum() > 10
    off = np.abs(length - ends)
    assert off[clear].max() < 0.02
    assert np.quantile(off, 0.9) < 0.06  # half a cell of the grid, in which round ones are cut
    assert np.median(off) < 0.02
    assert_integral(sim, x, e, read, length, lambda true: 0.5)


# ---------------------------------------------------------------- what it makes of the integral


def lasers(*sensors):
    """Lasers 3 m long in an even gas, side by side."""
    usual = EXACT | {"species": "ethanol", "range": 3.0}
    around = Surroundings(None, (100.0, 100.0), 0.05, 0.1)
    return Bench(*(usual | one for one in sensors), around=lambda: around, place=20.0)


def test_limits_lag_noise_mean_and_species():
    bench = lasers(
        {},
        {"gives": "mean"},
        {"detection_limit_ppm_m": 5.0, "largest_ppm_m": 60.0},
        {"rise_time": None, "decay_time": None},
        {"species": "methane"},
        {"noise_ppm_m": 2.0},
    )
    assert bench.measure(1.0)[:3] == pytest.approx([3.0, 1.0, 0.0], rel=1e-5)
    assert bench.measure(40.0)[:3] == pytest.approx([120.0, 40.0, 60.0], rel=1e-5)
    bench.series([0.0] * 20)
    *_, lagging, blind, noisy = bench.measure(10.0)
    assert lagging == pytest.approx(0.9 * 30.0, rel=1e-3)  # within 0.1 s
    assert blind == 0.0
    series = bench.series([10.0] * 300)[:, 5]
    assert np.std(series) == pytest.approx(2.0, rel=0.15)
    assert np.mean(series) == pytest.approx(30.0, abs=0.5)
    assert noisy != 30.0


def test_a_pan_unit_sweeps_to_and_fro():
    bench = lasers({"bearing_deg": 30.0, "sweep_deg": 80.0, "sweep_rate_deg": 50.0, "range": 9.0})
    bench.air.slope[None] = 1.0  # ppm per m of x
    for tick in range(1, 60):
        (read,) = bench.measure()
        swept = (5.0 * tick) % 160.0
        angle = np.radians(30.0 - 40.0 + min(swept, 160.0 - swept))
        assert read == pytest.approx(9.0 * 20.0 + 0.5 * 81.0 * np.cos(angle), rel=1e-4)


# ---------------------------------------------------------------- what is reported


@pytest.mark.parametrize(
    ("sensor", "algorithm", "reported"),
    [
        (
            {"species": "ethane"},
            {},
            ".sensors.gas.species: 'ethane' is not in the air of this scenario, the gas is",
        ),
        ({}, {"threshold_ppm": 8}, ".algorithm.threshold_ppm: 8 counts in ppm m"),
        ({"gives": "mean"}, {"threshold_ppm": 8}, ""),
    ],
)
def test_what_is_probably_not_meant_is_reported(tmp_path, sensor, algorithm, reported):
    gas = {"kind": "gaussian_plume", "intensity": 0.1, "sources": [{"position": [1.5, 2.0], "rate": 1e-4}]}
    scenario = room(gas, (6.0, 4.0), EXACT | sensor)
    scenario["robots"][0]["algorithm"] |= algorithm
    (tmp_path / "s.yaml").write_text(json.dumps(scenario))
    lines = [
        one for one in load(tmp_path / "s.yaml").resources.warnings if "species" in one or "threshold" in one
    ]
    assert [line for line in lines if line.startswith(f"robots[0]{reported}")] if reported else not lines, (
        lines
    )
