"""The maps against a literal reading of eq 1-8, with loops over snaps and cells in float64."""

from typing import Any

import numpy as np
import pytest
from readers import EXTENT, TRIALS, Readers, same

from taichi_plume.agents.inverse_distance import InverseDistanceMap
from taichi_plume.agents.time_series import TimeSeriesMap, neighbourhood
from taichi_plume.assemble import mappers
from taichi_plume.scenario import maps as map_models

pytestmark = pytest.mark.usefixtures("taichi")

CELL, WINDOW, DT = 0.25, 5.0, 0.5


def run(gas_map, seconds, pause=(np.inf, np.inf)):
    """Feed the map, but during `pause`; returns the samples of each snap: lists of (trial, x, y, reading)."""
    robots = Readers(4)
    snaps: list[list[tuple]] = [[] for _ in range(round(seconds / WINDOW) + 1)]
    for tick in range(1, round(seconds / DT) + 1):
        robots.wander()
        t = tick * DT
        if pause[0] < t <= pause[1]:
            continue
        gas_map.update(robots, t, DT)
        snaps[int(np.ceil(t / WINDOW)) - 1] += [tuple(row[:4]) for row in robots.rows(t)]
    return snaps


def cells():
    return [((i + 0.5) * CELL, (j + 0.5) * CELL) for i in range(8) for j in range(6)]


def interpolated(samples, trial, power=2.0, shortest=CELL / 2):
    """Eq 1-3 in every cell: C and W."""
    C, W = [], []
    for x, y in cells():
        weights = [max(np.hypot(x - a, y - b), shortest) ** -power for k, a, b, _ in samples if k == trial]
        values = [c for k, _, _, c in samples if k == trial]
        W.append(sum(weights))
        total = sum(w * c for w, c in zip(weights, values, strict=True))
        C.append(total / sum(weights) if weights else np.nan)
    return np.array(C), np.array(W)


def forecast(snaps, now, trial, alpha, beta, time_scale=0.1):
    """Eq 4-7 for snap number `now` from all before it."""
    place = np.array(cells())
    past = [(k, *interpolated(snaps[k], trial)) for k in range(now)]
    S, total = np.full(len(place), np.nan), np.zeros(len(place))
    for j, here in enumerate(place):
        above = below = 0.0
        for k, C, W in past:
            for i, there in enumerate(place):
                dist = alpha * np.hypot(*(here - there)) + (1 - alpha) * time_scale * (now - k) * WINDOW
                if dist < beta - 1e-9 and W[i] > 0:
                    above += C[i] * W[i] / dist
                    below += W[i] / dist
        total[j] = below
        if below > 0:
            S[j] = above / below
    return S, total


@pytest.mark.parametrize("alpha", [0.4, 0.9, 0.98])
@pytest.mark.parametrize("pause", [(np.inf, np.inf), (20.0, 30.0)], ids=["steady", "pause"])
def test_time_series_map_is_eq_1_to_8(alpha, pause):
    """45 s; with the pause, snaps 5 and 6 have no samples."""
    gas_map = TimeSeriesMap(map_models.TimeSeriesMap(kind="time_series", alpha=alpha), EXTENT, TRIALS)
    assert np.isnan(gas_map.estimate()).all()
    snaps = run(gas_map, 45.0, pause)
    assert gas_map.snaps.ended == 9
    assert gas_map.estimate().shape == (TRIALS, 8, 6)
    for trial in range(TRIALS):
        S, weight = forecast(snaps, 9, trial, alpha, 0.5)
        same(gas_map.estimate()[trial].ravel(), S)
        same(gas_map.weight()[trial].ravel(), weight)
    errors = dict(gas_map.errors)
    assert list(errors) == pytest.approx([10, 15, 20, 25, 30, 35, 40, 45])
    for snap in (1, 4, 7, 8):
        for trial in range(TRIALS):
            S, _ = forecast(snaps, snap, trial, alpha, 0.5)
            C, _ = interpolated(snaps[snap], trial)
            off = np.abs(S - C)
            expected = np.nan if np.isnan(off).all() else np.nanmean(off)
            assert errors[(snap + 1) * WINDOW][trial] == pytest.approx(expected, rel=1e-5, nan_ok=True)


def test_scales_and_ticks_are_free():
    """A large neighbourhood in which age counts twice as much, ticks that do not divide the window, a smaller team."""
    model = map_models.TimeSeriesMap(kind="time_series", alpha=0.8, beta=0.9, time_scale=0.2)
    gas_map, robots = TimeSeriesMap(model, EXTENT, TRIALS), Readers(9)
    robots.team_size.from_numpy(np.array([3, 1], np.int32))
    snaps: list[list[tuple]] = [[] for _ in range(6)]
    for tick in range(1, 38):
        robots.wander()
        gas_map.update(robots, t := 0.7 * tick, 0.7)
        snaps[int(np.ceil(t / WINDOW)) - 1] += [tuple(row[:4]) for row in robots.rows(t)[:4]]
    for trial in range(TRIALS):
        S, weight = forecast(snaps, 5, trial, 0.8, 0.9, 0.2)
        same(gas_map.estimate()[trial].ravel(), S)
        same(gas_map.weight()[trial].ravel(), weight)


def test_maps_that_share_snaps_are_what_they_are_alone():
    """With neighbourhoods, and so buffers, of different sizes; each is told the readings, in any order."""
    kinds = [
        map_models.TimeSeriesMap(kind="time_series", alpha=0.95),
        map_models.InverseDistanceMap(kind="inverse_distance"),
        map_models.TimeSeriesMap(kind="time_series", alpha=0.6, raw_samples=True),
        map_models.TimeSeriesMap(kind="time_series", alpha=0.4, beta=0.7),
    ]
    together = mappers(kinds, EXTENT, TRIALS, lambda points: points)
    alone = [mappers([one], EXTENT, TRIALS, lambda points: points)[0] for one in kinds]
    assert len({id(getattr(one, "snaps")) for one in together}) == 1  # noqa: B009
    robots = Readers(6)
    for tick in range(1, 70):
        robots.wander()
        for one in [*together[::-1], *alone]:
            one.update(robots, tick * DT, DT)
    for a, b in zip(together, alone, strict=True):
        np.testing.assert_array_equal(a.estimate(), b.estimate())
        np.testing.assert_array_equal(a.weight(), b.weight())
        np.testing.assert_array_equal([e for _, e in a.errors], [e for _, e in b.errors])


def test_nothing_is_known_right_after_an_empty_snap_when_the_neighbourhood_is_short():
    """alpha = 0.4 reaches one snap back: unknown, not zero."""
    gas_map = TimeSeriesMap(map_models.TimeSeriesMap(kind="time_series", alpha=0.4), EXTENT, TRIALS)
    robots: Any = Readers(1)
    robots.wander()
    gas_map.update(robots, 5.0, DT)
    assert np.isfinite(gas_map.estimate()).all()
    gas_map.update(robots, 12.0, DT)  # in the third snap; the second stayed empty
    assert gas_map.snaps.ended == 2
    assert np.isnan(gas_map.estimate()).all()
    assert (gas_map.weight() == 0).all()


@pytest.mark.parametrize("power", [1.0, 2.0, 3.5])
def test_inverse_distance_map_is_eq_1_to_3_of_the_last_snap(power):
    model = map_models.InverseDistanceMap(kind="inverse_distance", power=power, min_distance=0.05)
    gas_map = InverseDistanceMap(model, EXTENT, TRIALS)
    snaps = run(gas_map, 17.0)  # 2 s into the fourth snap
    for trial in range(TRIALS):
        C, W = interpolated(snaps[2], trial, power, 0.05)
        same(gas_map.estimate()[trial].ravel(), C)
        same(gas_map.weight()[trial].ravel(), W)
    times = [time for time, _ in gas_map.errors]
    assert times == [10, 15]
    before, after = interpolated(snaps[1], 1, power, 0.05)[0], interpolated(snaps[2], 1, power, 0.05)[0]
    assert gas_map.errors[-1][1][1] == pytest.approx(np.abs(before - after).mean(), rel=1e-5)


@pytest.mark.parametrize(
    ("alpha", "lags", "entries"),
    [(0.4, 1, 9), (0.5, 1, 9), (0.6, 2, 10), (0.8, 4, 20), (0.9, 9, 41), (0.98, 49, 209)],
)
def test_reach_of_the_neighbourhood(alpha, lags, entries):
    """Counted by hand from eq 4 and 5, beta = 0.5, 5 s and 0.25 m; a distance of exactly beta is outside."""
    stencil = neighbourhood(map_models.TimeSeriesMap(kind="time_series", alpha=alpha), 15)
    assert max(lag for lag, *_ in stencil) == lags
    assert len(stencil) == entries


def test_a_neighbourhood_without_any_snap_is_refused():
    with pytest.raises(ValueError, match="sees no past snap"):
        map_models.TimeSeriesMap(kind="time_series", alpha=0.4, window=20.0)


def test_cells_cover_the_floor():
    gas_map = InverseDistanceMap(
        map_models.InverseDistanceMap(kind="inverse_distance", cell=0.4), (2.0, 1.5), 1
    )
    assert gas_map.shape == (5, 4)


def test_raw_samples_take_the_place_of_cells():
    """Eq 6 with i over the samples of the past snaps, each with W = 1."""
    model = map_models.TimeSeriesMap(kind="time_series", alpha=0.8, raw_samples=True)
    gas_map = TimeSeriesMap(model, EXTENT, TRIALS)
    snaps = run(gas_map, 37.0, pause=(20.0, 25.0))
    for trial in range(TRIALS):
        above, below = np.zeros(48), np.zeros(48)
        for k in range(7):
            for number, x, y, reading in snaps[k]:
                dist = 0.8 * np.hypot(*(np.array(cells()) - (x, y)).T) + 0.2 * 0.1 * (7 - k) * WINDOW
                near = (dist < 0.5) & (number == trial)
                above[near] += reading / dist[near]
                below[near] += 1 / dist[near]
        S = np.where(below > 0, above / np.where(below > 0, below, 1), np.nan)
        assert 0 < np.isfinite(S).sum() < 48
        same(gas_map.estimate()[trial].ravel(), S)
        same(gas_map.weight()[trial].ravel(), below)
