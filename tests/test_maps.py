"""Maps of recorded readings: those of a run are the maps that its robots made."""

import json

import numpy as np
import pytest

from taichi_plume import maps, run
from taichi_plume.map_models import InverseDistanceMap, KernelMap

SCENARIO = """
name: readings
seed: 3
duration: 17
domain: {size: [2.0, 1.5], spacing: 0.05, depth: 0.5}
wind: {kind: uniform, velocity: [0.4, 0.0]}
gas: {kind: gaussian_plume, intensity: 0.1, sources: [{position: [0.3, 0.7], rate: 1.0e-6, radius: 0.05}]}
robots:
  - name: walkers
    count: 3
    trials: 2
    reach: 0
    odometry: {}
    start: {kind: area, low: [0.3, 0.3], high: [1.7, 1.2]}
    algorithm: {kind: random_walk}
    sensors: {gas: {kind: mox, model: mics5524}, wind: {kind: ultrasonic}}
maps:
  - {kind: time_series, alpha: 0.9}
  - {kind: kernel_dmv, cell: 0.1, wind_stretch: 0.25}
"""


@pytest.mark.slow
def test_readings_of_a_run_give_the_maps_of_the_run(tmp_path):
    path = tmp_path / "readings.yaml"
    path.write_text(SCENARIO)
    assert run.main([str(path), "--out", str(tmp_path / "run"), "--quiet", "--no-recording"]) == 0
    online = json.loads((tmp_path / "run" / "result.json").read_text())["maps"]
    table = str(tmp_path / "run" / "robots.parquet")
    for number, options in enumerate(
        (["--alpha", "0.9"], ["--kind=kernel_dmv", "--cell=0.1", "--wind-stretch=0.25"])
    ):
        out = tmp_path / str(number)
        size = ["--size", "2", "1.5", "--source", "0.3", "0.7", "--trial", "1"]
        assert maps.main([table, *size, *options, "--out", str(out)]) == 0
        scores = json.loads((out / "scores.json").read_text())
        assert scores["readings"] > 100
        peak = online[number]["mean_gas"]["per_trial_at_end"]["peak_distance_m"][1]
        if number == 0:  # its last snap ended with the last score
            assert scores["peak"]["to_source_m"] == pytest.approx(peak, abs=1e-6)
        assert (out / "map.png").read_bytes()[:4] == b"\x89PNG"
        rows = np.genfromtxt(out / "map.csv", delimiter=",", names=True)
        assert rows["ppm"][np.isfinite(rows["ppm"])].max() == pytest.approx(scores["peak"]["ppm"], rel=1e-6)
        assert ("variance_ppm2" in (rows.dtype.names or ())) == (number == 1)


def log(path, rows, header="t,x,y,reading"):
    path.write_text(header + "\n" + "".join(",".join(map(str, row)) + "\n" for row in rows))
    return path


def test_even_readings_make_an_even_map_whatever_the_clock_says(tmp_path):
    begin = 1.7e9 + 3.0
    rng = np.random.default_rng(1)
    rows = [(begin + k, *rng.uniform(0.0, 1.0, 2).round(3), 12.5) for k in range(20)]
    rows += [(begin + 4.0, 7.0, 0.5, 99.0), (begin + 4.0, 0.5, 0.5, "nan")]
    readings = maps.read(log(tmp_path / "a.csv", rows))
    gas_map = maps.map_of(readings, InverseDistanceMap(kind="inverse_distance"), (1.0, 1.0))
    np.testing.assert_allclose(gas_map.estimate, 12.5, rtol=1e-6)
    assert gas_map.scores["forecast_error_ppm"] == pytest.approx(0.0, abs=1e-5)
    assert gas_map.scores["forecast"]["time_s"][0] == pytest.approx(1.7e9 + 10.0)
    assert (gas_map.scores["readings"], gas_map.scores["left_out"]) == (20, 2)


def test_a_variance_is_judged_by_the_readings_to_come(tmp_path):
    """Normal readings around 50 ppm: the negative logarithm of their density is that of a normal distribution."""
    rng = np.random.default_rng(2)
    rows = [(0.1 * k, 0.5, 0.5, 50.0 + 4.0 * rng.standard_normal()) for k in range(1, 601)]
    readings = maps.read(log(tmp_path / "a.csv", rows))
    gas_map = maps.map_of(readings, KernelMap(kind="kernel_dmv", cell=0.25), (1.0, 1.0))
    entropy = 0.5 * np.log(2 * np.pi * np.e * 16.0)
    assert gas_map.scores["nlpd"] == pytest.approx(entropy, abs=0.15)  # five standard errors of 550 readings


@pytest.mark.parametrize(
    ("text", "options", "told"),
    [
        ("t,x,y,reading\n", [], "no readings"),
        ("t,x,reading\n1,0,2\n", [], "no column y; it has t, x, reading"),
        ("t,x,y,reading\n1,0,a,2\n", [], "column y is not of numbers"),
        ("t,x,y,reading\n1,0,nan,2\n", [], "y of row 1 is not a number"),
        ("t,x,y,reading\n1,9,9,2\n", [], "no reading lies on the floor of 2 x 1 m"),
        ("t,x,y,reading,trial\n1,0,0,2,0\n", ["--trial", "3"], "no trial 3"),
        ("t,x,y,reading\n1,0\n", [], "cannot be read"),
        (None, [], "cannot be read"),
        ("t,x,y,reading\n1,0,0,2\n", ["--alpha", "2"], "alpha: got 2: must be less than 1"),
        ("t,x,y,reading\n1,0,0,2\n", ["--alfa", "2"], "did you mean 'alpha'"),
        ("t,x,y,reading\n1,0,0,2\n", ["--alpha"], "--alpha"),
        ("t,x,y,reading\n1,0,0,2\n", ["--kind", "nose"], "unknown kind 'nose'"),
    ],
)
def test_what_is_wrong_is_told_in_one_line(text, options, told, tmp_path, capsys):
    path = tmp_path / "a.csv"
    if text is not None:
        path.write_text(text)
    assert maps.main([str(path), "--size", "2", "1", "--out", str(tmp_path / "out"), *options]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()
