"""Maps of a whole log: they forget nothing unless given, and what they forget they say."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from pydantic import TypeAdapter
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve
from scipy.spatial.distance import cdist

from taichi_plume.api.maps import maps as maps_of
from taichi_plume.cli import maps
from taichi_plume.files.readings import Readings, ReadingsError
from taichi_plume.results.recorded_maps import GasMap, map_of, of_log
from taichi_plume.scenario.maps import Map, TimeSeriesMap

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

SIZE = (2.0, 1.5)


def model(**keys):
    return TypeAdapter(Map).validate_python(keys)


def log(count: int = 240, step: float = 2.5, begin: float = 1.7e9 + 0.7) -> Readings:
    """Ten minutes of a robot that wanders about a plume, which has gone after three."""
    rng = np.random.default_rng(3)
    t = begin + step * np.arange(count)
    place = np.abs(np.cumsum(rng.normal(0.0, 0.15, (count, 2)), axis=0) + 0.7)
    place = np.array(SIZE) - np.abs(np.array(SIZE) - place % (2 * np.array(SIZE)))
    near = np.exp(-4.0 * ((place - (0.5, 0.6)) ** 2).sum(axis=1))
    reading = np.where(t - begin < 180.0, 90.0 * near + rng.exponential(5.0, count), 0.0)
    return Readings(t, place, reading, np.zeros((count, 2)), np.arange(count) + 1)


def centers(cell: float) -> np.ndarray:
    nodes = [(np.arange(round(side / cell)) + 0.5) * cell for side in SIZE]
    return np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1)


def inverse_distance(readings: Readings, cell: float) -> np.ndarray:
    """Shepard's mean of all readings, for the power 2 (eq 1 to 3 of Marjovi & Marques 2014, of one snap)."""
    apart = np.maximum(cdist(centers(cell).reshape(-1, 2), readings.place), cell / 2)
    return (apart**-2.0 @ readings.reading / (apart**-2.0).sum(axis=1)).reshape(centers(cell).shape[:2])


def field(readings: Readings, cell: float) -> np.ndarray:
    """What makes 0.01 Σ (m_i - m_j)² + 10 Σ (m_k - z)² least, over all neighbours and readings."""
    nx, ny = centers(cell).shape[:2]
    number = np.arange(nx * ny).reshape(nx, ny)
    neighbours = (number[:-1], number[1:]), (number[:, :-1], number[:, 1:])
    pairs = np.concatenate([np.stack([one.ravel(), other.ravel()], -1) for one, other in neighbours])
    rows = np.arange(len(pairs)).repeat(2)
    differences = coo_array((np.tile([1.0, -1.0], len(pairs)), (rows, pairs.ravel())), (len(pairs), nx * ny))
    at = number[tuple(np.minimum(readings.place // cell, (nx - 1, ny - 1)).astype(int).T)]
    takes = coo_array((np.ones(len(at)), (np.arange(len(at)), at)), (len(at), nx * ny))
    matrix = 0.01 * differences.T @ differences + 10.0 * takes.T @ takes
    return np.asarray(spsolve(matrix.tocsc(), 10.0 * takes.T @ readings.reading)).reshape(nx, ny)


def kernel(readings: Readings, cell: float) -> np.ndarray:
    """Mean of Kernel DM+V (Lilienthal et al. 2009), sigma 0.25 m, cut off at four of it, 5 readings for trust."""
    apart = cdist(centers(cell).reshape(-1, 2), readings.place) / 0.25
    weight = np.where(apart < 4.0, np.exp(-(apart**2) / 2.0), 0.0)
    total = weight.sum(axis=1)
    trust = 1.0 - np.exp(-((total / 5.0) ** 2))
    mean = trust * (weight @ readings.reading) / total + (1.0 - trust) * readings.reading.mean()
    return mean.reshape(centers(cell).shape[:2])


@pytest.mark.parametrize(
    ("kind", "reference", "rel"),
    [("inverse_distance", inverse_distance, 1e-5), ("gmrf", field, 1e-5), ("kernel_dmv", kernel, 1e-4)],
)
def test_a_map_of_a_log_is_of_all_its_readings(kind, reference, rel):
    readings = log()
    made = map_of(readings, model(kind=kind, cell=0.25), SIZE)
    np.testing.assert_allclose(made.estimate, reference(readings, 0.25), rtol=rel, atol=1e-5)
    assert (made.scores["readings"], made.scores["forgotten"]) == (240, 0)


@pytest.mark.parametrize(
    "keys", [{}, {"alpha": 0.6, "beta": 1.2}, {"cell": 0.5}, {"time_from": "forecast"}], ids=str
)
def test_a_time_series_of_a_log_reaches_back_to_its_begin(keys):
    """Eq 1 to 7 with 120 snaps of all the readings, the first of which is about half the neighbourhood away."""
    readings = log()
    reported = model(**{"kind": "time_series", "cell": 0.25} | keys)
    assert isinstance(reported, TimeSeriesMap)
    made = map_of(readings, reported, SIZE)
    assert made.scores["chosen_for_the_log"]["window"] == pytest.approx(5.0)
    assert made.scores["forgotten"] == 0
    scale = made.scores["chosen_for_the_log"]["time_scale"]
    t = np.round(readings.t - readings.t[0], 6)
    snap = np.maximum(np.ceil(t / 5.0 - 1e-9), 1.0).astype(int) - 1
    places = centers(reported.cell).reshape(-1, 2)
    between = cdist(places, places)
    since, shortest = (119, reported.cell / 2) if reported.time_from == "newest" else (120, 0.0)
    above, below = np.zeros(len(places)), np.zeros(len(places))
    for k in range(120):
        of = snap == k
        w = np.maximum(cdist(places, readings.place[of]), reported.cell / 2) ** -2.0
        age = (1.0 - reported.alpha) * scale * (since - k) * 5.0
        dist = reported.alpha * np.maximum(between, shortest) + age
        near = np.where(reported.alpha * between + age < reported.beta - 1e-9, 1.0 / dist, 0.0)
        assert near.any(axis=1).all(), k
        above += near @ (w @ readings.reading[of])
        below += near @ w.sum(axis=1)
    np.testing.assert_allclose(made.estimate.ravel(), above / below, rtol=1e-4)


TOLD = [
    ({"kind": "time_series", "window": 5.0}, 0.0),
    pytest.param({"kind": "time_series", "window": 7.0, "alpha": 0.97}, 0.0, marks=pytest.mark.slow),
    pytest.param({"kind": "time_series", "time_scale": 0.02, "beta": 0.7}, 0.0, marks=pytest.mark.slow),
    ({"kind": "inverse_distance", "window": 20.0}, 0.0),
    ({"kind": "gmrf", "memory": 60.0, "window": 4.0}, 1e-3),
    ({"kind": "kernel_dmv", "memory": 20.0, "sigma": 1.0}, 0.02),
]


@pytest.mark.parametrize(("keys", "slack"), TOLD, ids=lambda keys: str(keys))
def test_what_is_said_to_be_forgotten_is_what_changes_nothing(keys, slack):
    """Other values of the forgotten readings, the oldest ones, make the same map; of the next reading they do not."""
    readings, reported = log(), model(**{"cell": 0.25, **keys})

    def made(number: slice | int) -> GasMap:
        values = readings.reading.copy()
        values[number] += 50.0
        return map_of(replace(readings, reading=values), reported, SIZE)

    whole = made(slice(0, 0))
    forgotten = whole.scores["forgotten"]
    assert 0 < forgotten < 240
    assert whole.scores["chosen_for_the_log"] == {}
    np.testing.assert_allclose(made(slice(0, forgotten)).estimate, whole.estimate, atol=50.0 * slack)
    assert np.nanmax(np.abs(made(forgotten).estimate - whole.estimate)) > 0.0


def test_a_log_with_one_reading_per_robot_and_snap():
    """Three robots that report one after the other, in files by the column robot: the last reading of each counts."""
    log_of = pd.DataFrame(
        {
            "t": np.arange(1.0, 13.0),
            "x": np.tile([0.3, 0.9, 1.6], 4),
            "y": np.linspace(0.1, 1.4, 12),
            "reading": np.arange(12.0) ** 2,
            "robot": np.tile(["c", "a", "b"], 4),
        }
    )
    keys = {"kind": "inverse_distance", "cell": 0.25, "window": 20.0}
    made = maps_of(log_of, {**keys, "samples": "newest"}, size=SIZE)
    expected = maps_of(log_of.tail(3), keys, size=SIZE)
    np.testing.assert_allclose(made.estimate, expected.estimate, rtol=1e-6)
    assert not np.allclose(made.estimate, maps_of(log_of, keys, size=SIZE).estimate, rtol=0.1)
    with pytest.raises(ReadingsError, match="samples: newest needs the robot"):
        maps_of(log_of.drop(columns="robot"), {**keys, "samples": "newest"}, size=SIZE)


def test_samples_far_from_every_cell_count_as_forgotten():
    """Cells of 1 m, a neighbourhood of 0.2 m / 0.5 on the ground: what is beyond is in no cell."""
    reported = model(kind="time_series", raw_samples=True, cell=1.0, alpha=0.5, beta=0.2, time_scale=1e-4)
    places = np.array([[0.5, 0.5], [0.5, 0.8], [0.5, 0.95], [0.99, 0.99], [1.7, 0.4]])
    readings = Readings(np.arange(5.0), places, np.full(5, 7.0), np.zeros((5, 2)), np.arange(5))
    made = map_of(readings, reported, (2.0, 1.0))
    assert made.scores["forgotten"] == 2
    np.testing.assert_allclose(made.estimate, 7.0, rtol=1e-6)


def test_a_log_of_a_moment_or_of_days_is_mapped_whole():
    for step, count in ((1.0, 1), (0.01, 30), (900.0, 100)):
        for kind in ("time_series", "inverse_distance", "gmrf", "kernel_dmv"):
            made = map_of(log(count, step, 12.3), model(kind=kind, cell=0.5), SIZE)
            assert made.scores["forgotten"] == 0, (kind, step)
            assert np.isfinite(made.estimate).any()


def test_long_logs_of_large_floors_have_fewer_snaps():
    """No more memory than a floor of some rooms needs, whatever its cells."""
    readings = log(1000, 60.0)
    for cell in (0.25, 0.02, 0.01):
        reported, chosen = of_log(model(kind="time_series", cell=cell), readings, (40.0, 30.0))
        assert reported.bytes((40.0, 30.0), 1.0) < 2e9
        assert chosen["window"] >= 499.0
    assert of_log(model(kind="kernel_dmv"), readings, SIZE)[1] == {}


def command(tmp_path, capsys, *options):
    readings = log()
    rows = np.column_stack([readings.t - readings.t[0], readings.place, readings.reading])
    np.savetxt(tmp_path / "log.csv", rows, "%.6f", ",", header="t,x,y,reading", comments="")
    (tmp_path / "log.csv").open("a").write("600,9,9,1\n")
    out = tmp_path / "out"
    assert maps.main([str(tmp_path / "log.csv"), "--size", "2", "1.5", "--out", str(out), *options]) == 0
    read_in, *lines = capsys.readouterr().out.splitlines()
    assert read_in.startswith(f"{tmp_path / 'log.csv'}: ")
    return lines, json.loads((out / "scores.json").read_text())


def test_the_command_maps_the_whole_log_by_default(tmp_path, capsys):
    lines, scores = command(tmp_path, capsys)
    assert scores["peak"]["ppm"] > 1.0
    assert lines[1].startswith("240 readings, none forgotten; ")
    assert "window: 5, time_scale: 0.0041" in lines[1]
    assert lines[1].endswith("; 1 left out, as no number or off the floor")


def test_the_command_says_what_is_forgotten(tmp_path, capsys):
    lines, scores = command(tmp_path, capsys, "--map={kind: gmrf, memory: 60}")
    assert lines[0] == "no gas: 0 ppm in all known cells"
    assert scores["peak"] == {"x_m": None, "y_m": None, "ppm": 0.0}
    assert lines[1].startswith(f"{scores['forgotten']} of 240 readings forgotten; without memory")
    assert 215 <= scores["forgotten"] <= 217
