"""Metal oxides with heater cycles: against their equation, solved by SciPy."""

import json
from itertools import pairwise

import numpy as np
import pytest
from robots import Bench, room, team
from scipy.integrate import solve_ivp

from taichi_plume.assembly.preparation import load
from taichi_plume.scenario.loading import ScenarioError

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

MODEL = {"kind": "mox", "model": "mics5524", "noise": 0.0, "period": 1e-4}
C0, B = 1.6, 0.644


def bench(dt: float, *sensors) -> Bench:
    """Sensors of these heaters side by side."""
    return Bench(*(MODEL | one for one in sensors), dt=dt)


def resistances(of: Bench, levels):
    return of.series(levels, "resistance_ohm")


def solved(levels, tick, period, hot, slowness, rise, decay):
    """y at the end of the last hot part before each tick's end, by SciPy from switch to switch."""
    k_hot = 1.0 / (hot + (1.0 - hot) * slowness)
    y, last, out = 0.0, 0.0, []
    for n, level in enumerate(levels):
        goal, begin, end = B * np.log1p(level / C0), n * tick, (n + 1) * tick
        first = int(begin / period)
        switches = [(c + part) * period for c in range(first, int(end / period) + 2) for part in (0.0, hot)]
        edges = [begin, *(one for one in switches if begin + 1e-12 < one < end - 1e-12), end]
        for a, b in pairwise(edges):
            is_hot = (0.5 * (a + b) / period) % 1.0 < hot
            k = k_hot * (1.0 if is_hot else slowness)
            rate = k / (rise if goal > y else decay)
            path = solve_ivp(lambda _, z, r=rate, g=goal: (g - z) * r, (a, b), [y], rtol=1e-9, atol=1e-12)
            y = path.y[0, -1]
            if is_hot and abs((b / period) % 1.0 - hot) < 1e-6:
                last = y
        out.append(last)
    return np.array(out)


LEVELS = np.concatenate([np.zeros(3), np.full(14, 50.0), np.full(5, 5.0), np.zeros(15)])


@pytest.mark.parametrize("tick", [0.1, 0.013])
def test_the_signal_is_that_of_the_equation(tick):
    """Of cycles shorter and longer than a tick, by the resistance."""
    heaters = [
        {"period": 0.05},
        {"period": 0.071, "hot_share": 0.3, "activation_energy": 0.1},
        {"period": 0.47, "hot_share": 0.8, "hot": 600.0, "cold": 400.0, "activation_energy": 0.5},
    ]
    sensors = [{"heater": one} for one in heaters] + [{"heater": {}, "rise_time": 0.3, "decay_time": 1.0}]
    clean = np.sqrt(100e3 * 1500e3)
    y = np.log(clean / resistances(bench(tick, *sensors), LEVELS))
    e = 1.0 / 8.617333e-5
    slow = [np.exp(-0.3 * e * (1 / 423.15 - 1 / 673.15)), np.exp(-0.1 * e * (1 / 423.15 - 1 / 673.15))]
    slow.append(np.exp(-0.5 * e * (1 / 400.0 - 1 / 600.0)))
    reported = [(0.05, 0.5, slow[0], 0.087, 0.106), (0.071, 0.3, slow[1], 0.087, 0.106)]
    reported += [(0.47, 0.8, slow[2], 0.087, 0.106), (0.05, 0.5, slow[0], 0.3, 1.0)]
    for n, numbers in enumerate(reported):
        np.testing.assert_allclose(y[:, n], solved(LEVELS, tick, *numbers), atol=2e-3, err_msg=str(numbers))


def test_over_whole_cycles_it_rises_and_recovers_as_published():
    """87 ms and 106 ms (Dennler et al. 2024), where a steadily heated one takes seconds.

    Readings hold between the ends of two hot parts, here 10 ticks apart for the third.
    """
    three = bench(0.05, {"heater": {}}, {}, {"heater": {"period": 0.5}})
    clean = resistances(three, [0.0] * 5)[-1]
    up = np.log(clean / resistances(three, [50.0] * 60))
    down = np.log(clean / resistances(three, [0.0] * 40))
    changes = np.flatnonzero(np.diff(up[:, 2]))
    np.testing.assert_array_equal(np.diff(changes), 10)
    steady = B * np.log1p(50.0 / C0)
    t = 0.05 * np.arange(12)
    np.testing.assert_allclose(
        (steady - up[:12, 0]) / (steady - up[0, 0]), np.exp(-t / 0.087), rtol=2e-3, atol=2e-4
    )
    np.testing.assert_allclose(down[:12, 0] / down[0, 0], np.exp(-t / 0.106), rtol=2e-3, atol=2e-4)
    assert up[10, 0] > 0.99 * steady > 2.0 * up[10, 1]


def test_phases_are_right_after_a_million_ticks():
    seen = []
    for tick in (1_000_000, 1_000_000 % 7):  # 7 ticks are 3 cycles
        one = bench(0.03, {"heater": {"period": 0.07}})
        one.tick = tick
        seen.append(resistances(one, [0.0, *[50.0] * 20])[1:])
    np.testing.assert_allclose(*seen, rtol=1e-4)


@pytest.mark.parametrize(
    ("heater", "reported"),
    [
        (
            {"hot": 300.0},
            "robots[0].sensors.gas.heater.hot: 300 K must be above cold: 423.15 K",
        ),
        ({"hot_share": 1.5}, "robots[0].sensors.gas.heater.hot_share: got 1.5: must be at most 0.99"),
        ({"hot": "400 degC"}, ""),
    ],
)
def test_what_is_no_heater_is_reported(tmp_path, heater, reported):
    data = room(team([3.0, 1.0], sensors={"gas": MODEL | {"heater": heater}}))
    (tmp_path / "s.yaml").write_text(json.dumps(data))
    faults = []
    try:
        load(tmp_path / "s.yaml")
    except ScenarioError as error:
        faults = [line.partition("s.yaml: ")[2] for line in error.lines]
    assert any(line.startswith(reported) for line in faults) if reported else not faults, faults
