"""The maps against a literal reading of eq 1-8, in float64."""

import numpy as np
import pytest
from pydantic import TypeAdapter
from readers import COUNT, EXTENT, TRIALS, Stock, centers, same

from taichi_plume.agents.gas_map import Floor
from taichi_plume.agents.mapping import mappers
from taichi_plume.agents.snapshots import InverseDistanceMap, SnapMap
from taichi_plume.agents.time_series import TimeSeriesMap, neighbourhood
from taichi_plume.scenario import maps as map_models

pytestmark = pytest.mark.usefixtures("taichi")

CELL, WINDOW, DT = 0.25, 5.0, 0.5
FLOOR = Floor(EXTENT, TRIALS, COUNT + 1, DT)
PLACES = centers((8, 6), CELL)
READINGS = [
    {"alpha": alpha, "time_from": time_from}
    for time_from in ("newest", "forecast")
    for alpha in (0.4, 0.9, 0.98)
]


@pytest.fixture(scope="module")
def stock(taichi):
    return Stock()


@pytest.fixture
def of_alphas(taichi):
    """Maps that differ in alpha and time_from alone, and share their snaps."""
    return mappers([map_models.TimeSeriesMap(kind="time_series", **keys) for keys in READINGS], FLOOR)


def run(maps, robots, seconds, pause=(np.inf, np.inf)):
    """Feed the maps, but during `pause`; returns the samples of each snap: rows of (trial, x, y, reading)."""
    snaps: list[list] = [[] for _ in range(round(seconds / WINDOW) + 1)]
    for tick in range(1, round(seconds / DT) + 1):
        robots.wander()
        t = tick * DT
        if pause[0] < t <= pause[1]:
            continue
        for one in maps:
            one.update(robots, t, DT)
        snaps[int(np.ceil(t / WINDOW)) - 1].extend(robots.rows(t)[:, :4])
    return [np.array(rows).reshape(-1, 4) for rows in snaps]


def interpolated(samples, trial, power=2.0, shortest=CELL / 2):
    """Eq 1-3 in every cell: C and W."""
    _, x, y, value = samples[samples[:, 0] == trial].T
    distance = np.hypot(PLACES[:, :1] - x, PLACES[:, 1:] - y)
    weights = np.maximum(distance, shortest) ** -power
    W = weights.sum(axis=1)
    return (weights @ value / W if len(x) else np.full(len(PLACES), np.nan)), W


def forecast(snaps, now, trial, alpha, beta, time_scale=0.1, time_from="newest"):
    """Eq 4-7 for snap number `now` from all before it. T counts from the snap before, at distances of a half cell or
    more, or from the forecast snap.
    """
    since, shortest = (now - 1, CELL / 2) if time_from == "newest" else (now, 0.0)
    apart = np.linalg.norm(PLACES[:, None] - PLACES, axis=-1)
    above, below = np.zeros(len(PLACES)), np.zeros(len(PLACES))
    for k in range(now):
        C, W = interpolated(snaps[k], trial)
        age = (1 - alpha) * time_scale * (since - k) * WINDOW
        U = np.where(alpha * apart + age < beta - 1e-9, 1 / (alpha * np.maximum(apart, shortest) + age), 0.0)
        above += U @ np.where(W > 0, C * W, 0.0)
        below += U @ W
    return np.where(below > 0, above / np.where(below > 0, below, 1), np.nan), below


@pytest.mark.parametrize("pause", [(np.inf, np.inf), (20.0, 30.0)], ids=["steady", "pause"])
def test_time_series_map_is_eq_1_to_8(stock, of_alphas, pause):
    """45 s; with the pause, snaps 5 and 6 have no samples."""
    for one in of_alphas:
        assert np.isnan(one.estimate()).all()
    snaps = run(of_alphas, stock.robots(4), 45.0, pause)
    for keys, gas_map in zip(READINGS, of_alphas, strict=True):
        assert gas_map.snaps.ended == 9
        assert gas_map.estimate().shape == (TRIALS, 8, 6)
        errors = dict(gas_map.errors)
        assert list(errors) == pytest.approx([10, 15, 20, 25, 30, 35, 40, 45]), keys
        for trial in range(TRIALS):
            S, weight = forecast(snaps, 9, trial, beta=0.5, **keys)
            same(gas_map.estimate()[trial].ravel(), S)
            same(gas_map.weight()[trial].ravel(), weight)
            for snap in (1, 4, 7, 8):
                S, _ = forecast(snaps, snap, trial, beta=0.5, **keys)
                C, _ = interpolated(snaps[snap], trial)
                off = np.abs(S - C)
                expected = np.nan if np.isnan(off).all() else np.nanmean(off)
                found = errors[(snap + 1) * WINDOW][trial]
                assert found == pytest.approx(expected, rel=1e-5, nan_ok=True), (keys, trial, snap)


def test_scales_and_ticks_are_free(stock):
    """A large neighbourhood in which age counts twice as much, ticks that do not divide the window, a smaller team."""
    model = map_models.TimeSeriesMap(kind="time_series", alpha=0.8, beta=0.9, time_scale=0.2)
    gas_map = TimeSeriesMap(model, Floor(EXTENT, TRIALS, COUNT + 1, 0.7))
    robots = stock.robots(9)
    robots.teams(3, 1)
    snaps: list = [[] for _ in range(6)]
    for tick in range(1, 38):
        robots.wander()
        gas_map.update(robots, t := 0.7 * tick, 0.7)
        snaps[int(np.ceil(t / WINDOW)) - 1].extend(robots.rows(t)[:4, :4])
    snaps = [np.array(rows) for rows in snaps]
    for trial in range(TRIALS):
        S, weight = forecast(snaps, 5, trial, 0.8, 0.9, 0.2)
        same(gas_map.estimate()[trial].ravel(), S)
        same(gas_map.weight()[trial].ravel(), weight)


def test_maps_that_share_snaps_are_what_they_are_alone(stock):
    """With neighbourhoods, and so buffers, of different sizes; each gets the readings, in any order."""
    kinds = [
        map_models.TimeSeriesMap(kind="time_series", alpha=0.95),
        map_models.InverseDistanceMap(kind="inverse_distance"),
        map_models.TimeSeriesMap(kind="time_series", alpha=0.6, raw_samples=True),
        map_models.TimeSeriesMap(kind="time_series", alpha=0.4, beta=0.7),
        map_models.InverseDistanceMap(kind="inverse_distance", samples="newest"),
    ]
    together = mappers(kinds, FLOOR)
    alone = [mappers([one], FLOOR)[0] for one in kinds]
    assert [id(one.snaps) == id(together[0].snaps) for one in together] == [True] * 4 + [False]
    assert all(isinstance(one, SnapMap) for one in together)
    robots = stock.robots(6)
    for tick in range(1, 70):
        robots.wander()
        for one in [*together[::-1], *alone]:
            one.update(robots, tick * DT, DT)
    for a, b in zip(together, alone, strict=True):
        np.testing.assert_array_equal(a.estimate(), b.estimate())
        np.testing.assert_array_equal(a.weight(), b.weight())
        np.testing.assert_array_equal([e for _, e in a.errors], [e for _, e in b.errors])


def test_nothing_is_known_right_after_an_empty_snap_when_the_neighbourhood_is_short(stock, of_alphas):
    """alpha = 0.4 reaches one snap back from the forecast: unknown, not zero."""
    gas_map = of_alphas[READINGS.index({"alpha": 0.4, "time_from": "forecast"})]
    robots = stock.robots(1)
    robots.wander()
    gas_map.update(robots, 5.0, DT)
    assert np.isfinite(gas_map.estimate()).all()
    gas_map.update(robots, 12.0, DT)  # in the third snap; the second stayed empty
    assert gas_map.snaps.ended == 2
    assert np.isnan(gas_map.estimate()).all()
    assert (gas_map.weight() == 0).all()


def test_inverse_distance_map_is_eq_1_to_3_of_the_last_snap(stock):
    powers = (1.0, 2.0, 3.5)
    maps = [
        InverseDistanceMap(
            map_models.InverseDistanceMap(kind="inverse_distance", power=power, min_distance=0.05), FLOOR
        )
        for power in powers
    ]
    snaps = run(maps, stock.robots(4), 17.0)  # 2 s into the fourth snap
    for power, gas_map in zip(powers, maps, strict=True):
        for trial in range(TRIALS):
            C, W = interpolated(snaps[2], trial, power, 0.05)
            same(gas_map.estimate()[trial].ravel(), C)
            same(gas_map.weight()[trial].ravel(), W)
        times = [time for time, _ in gas_map.errors]
        assert times == [10, 15], power
        before, after = interpolated(snaps[1], 1, power, 0.05)[0], interpolated(snaps[2], 1, power, 0.05)[0]
        assert gas_map.errors[-1][1][1] == pytest.approx(np.abs(before - after).mean(), rel=1e-5), power


@pytest.mark.parametrize(
    ("alpha", "lags", "entries"),
    [(0.4, 1, 9), (0.5, 1, 9), (0.6, 2, 10), (0.8, 4, 20), (0.9, 9, 41), (0.98, 49, 209)],
)
def test_reach_of_the_neighbourhood(alpha, lags, entries):
    """Counted by hand from eq 4 and 5, beta = 0.5, 5 s and 0.25 m; a distance of exactly beta is outside."""
    stencil = neighbourhood(
        map_models.TimeSeriesMap(kind="time_series", alpha=alpha, time_from="forecast"), 15
    )
    assert max(lag for lag, *_ in stencil) == lags
    assert len(stencil) == entries


@pytest.mark.parametrize(
    ("alpha", "radius", "age"),
    [
        (0.4, 1.25, 8.33),
        (0.5, 1.0, 10.0),
        (0.6, 0.83, 12.5),
        (0.8, 0.625, 25.0),
        (0.9, 0.55, 50.0),
        (0.98, 0.51, 250),
    ],
)
def test_the_neighbourhoods_are_those_that_the_paper_lists(alpha, radius, age):
    """[radius, age] as printed, the age of 0.95 with the alpha that has it: the largest cone within eq 5, from its base
    in the newest snap on. Snaps of 1 s and cells of 1 cm, below the two digits that are printed.
    """
    fine = map_models.TimeSeriesMap(kind="time_series", alpha=alpha, cell=0.01, window=1.0)
    reach = max(dx for lag, dx, dy, _ in neighbourhood(fine, 150) if (lag, dy) == (1, 0))
    oldest = max(lag for lag, *_ in neighbourhood(fine.model_copy(update={"cell": 0.6}), 5)) - 1
    assert reach * 0.01 == pytest.approx(radius, abs=0.011)
    assert oldest == pytest.approx(age, abs=1.001)


def test_the_newest_value_of_a_cell_counts_as_from_its_edge():
    """U of the cell itself is finite, that of any neighbour as by eq 7: 1 / (alpha d + (1 - alpha) T)."""
    model = map_models.TimeSeriesMap(kind="time_series", alpha=0.8)
    weight = {(lag, dx, dy): U for lag, dx, dy, U in neighbourhood(model, 15)}
    assert weight[1, 0, 0] == pytest.approx(1 / (0.8 * 0.125))
    assert weight[1, 1, 0] == pytest.approx(1 / (0.8 * 0.25))
    assert weight[2, 0, 1] == pytest.approx(1 / (0.8 * 0.25 + 0.2 * 0.1 * 5.0))


def test_cells_cover_the_floor():
    model = map_models.InverseDistanceMap(kind="inverse_distance", cell=0.4)
    assert InverseDistanceMap(model, Floor((2.0, 1.5), 1, 1, DT)).shape == (5, 4)


@pytest.mark.parametrize(("time_from", "since", "shortest"), [("newest", 6, 0.125), ("forecast", 7, 0.0)])
def test_raw_samples_take_the_place_of_cells(stock, time_from, since, shortest):
    """Eq 6 with i over the samples of the past snaps, each with W = 1."""
    model = map_models.TimeSeriesMap(kind="time_series", alpha=0.8, raw_samples=True, time_from=time_from)
    gas_map = TimeSeriesMap(model, FLOOR)
    snaps = run([gas_map], stock.robots(4), 37.0, pause=(20.0, 25.0))
    for trial in range(TRIALS):
        above, below = np.zeros(48), np.zeros(48)
        for k in range(7):
            for number, x, y, reading in snaps[k]:
                apart = np.hypot(*(PLACES - (x, y)).T)
                age = 0.2 * 0.1 * (since - k) * WINDOW
                near = (0.8 * apart + age < 0.5) & (number == trial)
                dist = 0.8 * np.maximum(apart, shortest) + age
                above[near] += reading / dist[near]
                below[near] += 1 / dist[near]
        S = np.where(below > 0, above / np.where(below > 0, below, 1), np.nan)
        assert np.isfinite(S).any()
        same(gas_map.estimate()[trial].ravel(), S)
        same(gas_map.weight()[trial].ravel(), below)


@pytest.mark.parametrize("kind", ["inverse_distance", "time_series"])
def test_one_reading_per_robot_and_snap_is_the_newest(stock, kind):
    """Eq 1 to 7 with N samples for N robots: the last valid reading of each; robot 1 reads nothing after 3 s of each
    snap, robot 4 nothing at all in the second.
    """
    gas_map = mappers(
        [TypeAdapter(map_models.Map).validate_python({"kind": kind, "samples": "newest"})], FLOOR
    )[0]
    assert isinstance(gas_map, SnapMap)
    robots, snaps = stock.robots(4), [{} for _ in range(4)]
    for tick in range(1, 37):
        robots.wander()
        t = tick * DT
        number = int(np.ceil(t / WINDOW)) - 1
        readings = robots.readings.copy()
        if t - number * WINDOW > 3.0:
            readings[1] = np.nan
        if number == 1:
            readings[4] = np.inf
        robots.show(robots.where, readings)
        gas_map.update(robots, t, DT)
        for robot, row in enumerate(robots.rows(t)[:, :4]):
            if np.isfinite(row[3]):
                snaps[number][robot] = row
    rows = [np.array(list(of.values())) for of in snaps]
    assert [len(of) for of in rows[:3]] == [6, 5, 6]
    assert gas_map.snaps.samples.shape[2] == FLOOR.robots
    for trial in range(TRIALS):
        if kind == "inverse_distance":
            S, weight = interpolated(rows[2], trial)
        else:
            S, weight = forecast(rows, 3, trial, 0.9, 0.5)
        same(gas_map.estimate()[trial].ravel(), S)
        same(gas_map.weight()[trial].ravel(), weight)
