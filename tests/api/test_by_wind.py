"""The class of docs/howto/own_algorithm.md that hands over between surges by the wind and spirals without it."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import taichi_plume as tp

PAGE = Path(__file__).parents[2] / "docs/howto/own_algorithm.md"
SOURCE = (3.5, 1.5)  # m


@pytest.fixture(scope="module")
def by_wind():
    text = PAGE.read_text(encoding="utf-8")
    (block,) = re.findall(r":caption: by_wind\.py\n(.*?)```", text, re.DOTALL)
    names: dict = {"__name__": __name__}
    exec(block, names)
    return names["ByWind"]


def test_it_hands_over_when_the_wind_stays_away_or_stays(by_wind):
    search, dt = by_wind(patience=3.0), 0.5
    robots = SimpleNamespace(
        **{name: np.zeros(1) for name in ("reading", "heading", "path_length", "speed", "state")},
        wind=np.array([[0.2, 0.0]]),
        wind_known=np.ones(1, int),
        blocked=np.zeros(1, int),
        turn_to=lambda course: None,
        dt=dt,
    )
    spirals = []
    for k, felt in enumerate([1] * 10 + [0] * 4 + [1] * 4 + [0] * 10 + [1] * 4 + [0] * 4 + [1] * 10):
        robots.t = k * dt
        robots.wind_known[:] = felt
        search.act(robots)
        spirals.append(search.STATE_NAMES[int(robots.state[0])] in ("ARM", "ACQUIRE"))
    began, ended = np.flatnonzero(np.diff(spirals)) + 1
    assert (began, ended) == (
        10 + 4 + 4 + 6,
        10 + 4 + 4 + 10 + 4 + 4 + 6,
    )  # 3 s of 0.5 s after the last change


def concentration(points, t):
    return 20.0 / (0.3 + np.hypot(*(points - np.array(SOURCE)).T))


def searched(by_wind, wind: float):
    """States of six robots in a wind towards smaller x, and whether they found the source."""
    start = {"kind": "area", "low": [0.8, 0.6], "high": [1.6, 2.4]}
    data = {
        "duration": 900.0,
        "tick": 0.25,
        "domain": {"size": [4.5, 3.0], "spacing": 0.1},
        "wind": {"kind": "uniform", "velocity": [-wind, 0.0]},
        "robots": [
            {
                "count": 1,
                "trials": 6,
                "start": start,
                "algorithm": tp.Own(by_wind, acquisition=5.0),
                "sensors": {"gas": {"kind": "ideal"}, "wind": {"kind": "thermal"}},
            }
        ],
    }
    gas = tp.Own(concentration) | {"sources": [{"position": list(SOURCE)}]}
    seen = set()
    with tp.Simulation(data, overrides={"gas": gas}) as sim:
        sim.every(1.0, lambda sim: seen.update(sim.robots["state"]))
        sim.run()
        return seen, sim.robots["found"].to_numpy(bool)


@pytest.mark.usefixtures("taichi")
def test_it_finds_the_source_without_wind_by_spirals(by_wind):
    seen, found = searched(by_wind, 0.02)  # below the threshold of the anemometer
    assert {"ARM", "ACQUIRE"} <= seen
    assert found.all()


@pytest.mark.usefixtures("taichi")
def test_it_starts_no_spiral_in_wind(by_wind):
    seen, _ = searched(by_wind, 0.3)
    assert seen <= {"UPWIND", "CAST"}
