"""What holds for every gas map: what it does not know it says, whatever the robots do."""

import numpy as np
import pytest
from pydantic import TypeAdapter
from readers import EXTENT, Readers, same

from taichi_plume.assemble import mappers
from taichi_plume.scenario.maps import Map

pytestmark = pytest.mark.usefixtures("taichi")

KINDS = [
    {"kind": "time_series"},
    {"kind": "time_series", "raw_samples": True},
    {"kind": "inverse_distance"},
    {"kind": "kernel_dmv"},
    {"kind": "kernel_dmv", "memory": 60, "wind_stretch": 0.25},
    {"kind": "gmrf", "window": 5},
]
every_kind = pytest.mark.parametrize("keys", KINDS, ids=lambda keys: " ".join(map(str, keys.values())))
DT = 0.5
WINDOW = 10  # ticks


def made(keys, trials=1):
    model = TypeAdapter(Map).validate_python({**keys, "cell": 0.25})
    return mappers([model], EXTENT, trials, lambda points: np.full(points.shape[:-1], np.inf))[0]


def show(gas_map, robots, where, readings, ticks=range(1, WINDOW + 1)):
    """Robots that stay where they are, for a window."""
    robots.show(where, readings)
    for tick in ticks:
        gas_map.update(robots, tick * DT, DT)


def layers(gas_map):
    """All that it tells."""
    return [getattr(gas_map, name)() for name in ("estimate", "weight", "variance") if hasattr(gas_map, name)]


@every_kind
def test_without_readings_nothing_is_known(keys):
    gas_map, robots = made(keys, 2), Readers(1)
    robots.team_size.fill(0)
    assert np.isnan(gas_map.estimate()).all()
    show(gas_map, robots, robots.where, np.ones(6))
    assert gas_map.estimate().shape == (2, 8, 6)
    assert np.isnan(gas_map.estimate()).all()
    assert (gas_map.weight() == 0).all()
    if hasattr(gas_map, "variance"):
        assert np.isnan(gas_map.variance()).all()


@every_kind
@pytest.mark.parametrize(
    ("place", "reading"),
    [
        ((1.0, 0.7), np.nan),
        ((1.0, 0.7), np.inf),
        *((place, 50.0) for place in ((1.0, -0.01), (-0.01, 1.0), (1.0, 1.51), (2.01, 1.0))),
    ],
)
def test_what_is_no_reading_is_left_out(keys, place, reading):
    """A third robot reads no number, or believes to be off the map: it might as well not be there."""
    with_it, without = made(keys), made(keys)
    two, three = Readers(1, trials=1, count=2), Readers(1, trials=1, count=3)
    where = [(0.3, 0.4), (1.6, 1.1), place]
    show(without, two, where[:2], [4.0, 9.0])
    show(with_it, three, where, [4.0, 9.0, reading])
    for a, b in zip(layers(with_it), layers(without), strict=True):
        same(a, b)


@every_kind
def test_one_robot_that_stands_still_tells_its_reading(keys):
    """Where the map knows anything it is that reading, at the corner of the floor too."""
    gas_map, robots = made(keys), Readers(1, trials=1, count=1)
    show(gas_map, robots, [EXTENT], [12.0])
    estimate = gas_map.estimate()[0]
    assert estimate[-1, -1] == pytest.approx(12.0, rel=1e-5)
    np.testing.assert_allclose(estimate[np.isfinite(estimate)], 12.0, rtol=1e-5)
    assert (np.isnan(estimate) == (gas_map.weight()[0] == 0)).all()


@every_kind
def test_no_gas_is_known_to_be_none(keys):
    gas_map, robots = made(keys), Readers(1, trials=1)
    show(gas_map, robots, robots.where, np.zeros(3))
    estimate = gas_map.estimate()
    assert np.isfinite(estimate).any()
    assert (estimate[np.isfinite(estimate)] == 0).all()


@pytest.mark.parametrize("keys", KINDS[3:5], ids=["kernel", "kernel with memory and wind"])
def test_cells_out_of_reach_are_unknown(keys):
    gas_map, robots = made(keys), Readers(1, trials=1, count=1)
    show(gas_map, robots, [[0.125, 0.125]], [5.0])
    assert np.isfinite(gas_map.estimate()[0, :4, 0]).all()  # 0.75 m
    assert np.isnan(gas_map.estimate()[0, 4:]).all()  # 1 m, four times sigma
    assert (gas_map.weight()[0, 4:] == 0).all()


@every_kind
def test_trials_do_not_see_each_other(keys):
    """The second trial alone gives what it gives beside the first, which has one robot only; its own lose their
    readings for a while.
    """
    both, alone = made(keys, 2), made(keys)
    six, three = Readers(1), Readers(1, trials=1)
    six.team_size.from_numpy(np.array([1, 3], np.int32))
    rng = np.random.default_rng(3)
    for tick in range(1, 3 * WINDOW + 1):
        where, readings = rng.uniform(0, EXTENT, (6, 2)), rng.exponential(20.0, 6)
        readings[3:] *= np.where(8 < tick < 14, np.nan, 1.0)
        show(both, six, where, readings, range(tick, tick + 1))
        show(alone, three, where[3:], readings[3:], range(tick, tick + 1))
    for a, b in zip(layers(both), layers(alone), strict=True):
        same(a[1], b[0], 1e-6)
