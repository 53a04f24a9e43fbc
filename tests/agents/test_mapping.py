"""What holds for every gas map: what it does not know it says, whatever the robots do."""

import numpy as np
import pytest
from pydantic import TypeAdapter
from readers import COUNT, EXTENT, Stock, same
from saved import assert_goes_on, assert_plain

from taichi_plume.agents.gas_map import Floor
from taichi_plume.agents.mapping import KINDS, mappers
from taichi_plume.agents.wind_map import WindMap
from taichi_plume.grid.state import State
from taichi_plume.scenario.maps import Map

pytestmark = pytest.mark.usefixtures("taichi")

# with other numbers of the same structure
OF_EACH = [
    ({"kind": "time_series"}, {}),
    ({"kind": "time_series", "raw_samples": True}, {}),
    ({"kind": "inverse_distance"}, {}),
    ({"kind": "kernel_dmv"}, {"sigma": 0.2, "sigma_omega": 3.0, "wind_stretch": 0.1}),
    ({"kind": "kernel_dmv", "memory": 60, "wind_stretch": 0.25}, {"memory": 3.0, "wind_stretch": 0.0}),
    ({"kind": "gmrf", "window": 5}, {"window": 2, "memory": 7, "lambda_prior": 0.2, "lambda_observation": 3}),
    ({"kind": "time_series", "samples": "newest"}, {}),
]
every_kind = pytest.mark.parametrize(
    "keys", [keys for keys, _ in OF_EACH], ids=lambda keys: " ".join(map(str, keys.values()))
)
DT = 0.5
WINDOW = 10  # ticks


@pytest.fixture(scope="module")
def stock(taichi):
    return Stock()


def model(keys):
    return TypeAdapter(Map).validate_python({**keys, "cell": 0.25})


@pytest.fixture
def made(stock):
    """A map of these keys that begins anew."""

    def make(keys, trials=1):
        floor = Floor(EXTENT, trials, COUNT + 1, DT)
        return stock.map(KINDS[keys["kind"]], model(keys), floor)

    return make


def show(gas_map, robots, where, readings, ticks=range(1, WINDOW + 1)):
    """Robots that stay where they are, for a window."""
    robots.show(where, readings)
    for tick in ticks:
        gas_map.update(robots, tick * DT, DT)
    return gas_map


def layers(gas_map):
    """All that it tells."""
    return [getattr(gas_map, name)() for name in ("estimate", "weight", "variance") if hasattr(gas_map, name)]


@every_kind
def test_without_readings_nothing_is_known(stock, made, keys):
    gas_map, robots = made(keys, 2), stock.robots(1)
    robots.teams(0, 0)
    assert np.isnan(gas_map.estimate()).all()
    show(gas_map, robots, robots.where, np.ones(6))
    assert gas_map.estimate().shape == (2, 8, 6)
    assert np.isnan(gas_map.estimate()).all()
    assert (gas_map.weight() == 0).all()
    if hasattr(gas_map, "variance"):
        assert np.isnan(gas_map.variance()).all()


PLACES = [(1.0, -0.01), (-0.01, 1.0), (1.0, 1.51), (2.01, 1.0)]
NO_READINGS = [((1.0, 0.7), np.nan), ((1.0, 0.7), np.inf), *((place, 50.0) for place in PLACES)]


@every_kind
def test_what_is_no_reading_is_left_out(stock, made, keys):
    """A third robot reads no number, or believes to be off the map: it might as well not be there."""
    robots, where = stock.robots(1, trials=1), [(0.3, 0.4), (1.6, 1.1)]
    without = layers(show(made(keys), robots, where, [4.0, 9.0]))
    assert np.isfinite(without[0]).any()
    for place, reading in NO_READINGS:
        for a, b in zip(
            layers(show(made(keys), stock.robots(1, trials=1), [*where, place], [4.0, 9.0, reading])),
            without,
            strict=True,
        ):
            np.testing.assert_array_equal(a, b, f"{reading} at {place}")


@every_kind
def test_one_robot_that_stands_still_tells_its_reading(stock, made, keys):
    """Where the map knows anything it is that reading, at the corner of the floor too."""
    gas_map, robots = made(keys), stock.robots(1, trials=1)
    show(gas_map, robots, [EXTENT], [12.0])
    estimate = gas_map.estimate()[0]
    assert estimate[-1, -1] == pytest.approx(12.0, rel=1e-5)
    np.testing.assert_allclose(estimate[np.isfinite(estimate)], 12.0, rtol=1e-5)
    assert (np.isnan(estimate) == (gas_map.weight()[0] == 0)).all()


@every_kind
def test_no_gas_is_known_to_be_none(stock, made, keys):
    gas_map, robots = made(keys), stock.robots(1, trials=1)
    show(gas_map, robots, robots.where, np.zeros(3))
    estimate = gas_map.estimate()
    assert np.isfinite(estimate).any()
    assert (estimate[np.isfinite(estimate)] == 0).all()


@pytest.mark.parametrize("number", [3, 4], ids=["kernel", "kernel with memory and wind"])
def test_cells_out_of_reach_are_unknown(stock, made, number):
    gas_map, robots = made(OF_EACH[number][0]), stock.robots(1, trials=1)
    show(gas_map, robots, [[0.125, 0.125]], [5.0])
    assert np.isfinite(gas_map.estimate()[0, :4, 0]).all()  # 0.75 m
    assert np.isnan(gas_map.estimate()[0, 4:]).all()  # 1 m, four times sigma
    assert (gas_map.weight()[0, 4:] == 0).all()


@every_kind
def test_trials_do_not_see_each_other(stock, made, keys):
    """The second trial alone gives what it gives beside the first, which has one robot only; its own lose their
    readings for a while.
    """
    both, alone = made(keys, 2), made(keys)
    six, three = stock.robots(1), stock.robots(1, trials=1)
    six.teams(1, 3)
    rng = np.random.default_rng(3)
    for tick in range(1, 3 * WINDOW + 1):
        where, readings = rng.uniform(0, EXTENT, (6, 2)), rng.exponential(20.0, 6)
        readings[3:] *= np.where(8 < tick < 14, np.nan, 1.0)
        show(both, six, where, readings, range(tick, tick + 1))
        show(alone, three, where[3:], readings[3:], range(tick, tick + 1))
    for a, b in zip(layers(both), layers(alone), strict=True):
        same(a[1], b[0], 1e-6)


@every_kind
def test_a_map_goes_on_from_a_saved_state(stock, made, keys):
    gas_map, robots = made(keys), stock.robots(1, trials=1)

    def play(first, last):
        for tick in range(first * WINDOW // 2 + 1, last * WINDOW // 2 + 1):
            rng = np.random.default_rng(tick)
            readings = rng.exponential(20.0, 3)
            show(gas_map, robots, rng.uniform(0, EXTENT, (3, 2)), readings, range(tick, tick + 1))
        return *layers(gas_map), np.array([error for _, error in gas_map.errors])

    assert_goes_on(gas_map, play)


def test_maps_go_on_from_the_middle_of_a_snap(stock):
    """All kinds, those of one kind with the same snaps; in between they map something else, and more of it."""
    maps = mappers([model(keys) for keys, _ in OF_EACH], Floor(EXTENT, 2, COUNT + 1, DT))
    robots, states = stock.robots(1), [State(one) for one in maps]

    def go(first, last, seed):
        rng = np.random.default_rng(seed)
        for tick in range(first, last):
            robots.show(rng.uniform(0, EXTENT, (6, 2)), rng.exponential(20.0, 6))
            for one in maps:
                one.update(robots, tick * DT, DT)
        reported = [layer for one in maps for layer in layers(one)]
        return [*reported, *(one.errors.values for one in maps), *(one.errors.times for one in maps)]

    go(1, 43, 1)
    saved = [state.save() for state in states]
    assert_plain(saved)
    rest = go(43, 97, 2)
    go(97, 230, 3)
    for state, what in zip(states, saved, strict=True):
        state.restore(what)
    for again, first in zip(go(43, 97, 2), rest, strict=True):
        np.testing.assert_array_equal(again, first)


def test_each_kind_of_a_scenario_is_known():
    kinds = {keys["kind"] for keys, _ in OF_EACH}
    assert {kind for kind, made in KINDS.items() if made is not WindMap} == kinds, (
        "test_wind_map has the wind"
    )
    assert not mappers([], Floor(EXTENT, 1, 1, DT))
