"""Maps of the wind in runs: the truth of a uniform wind, files, scores, report, and what refuses them."""

import numpy as np
import pytest
import yaml

import taichi_plume as tp
from taichi_plume.files import maps_file
from taichi_plume.files.readings import ReadingsError
from taichi_plume.report.maps import maps_of
from taichi_plume.scoring import trials as scores

pytestmark = pytest.mark.usefixtures("taichi")

SCENARIO = """
name: wind
duration: 12
domain: {size: [2.0, 1.5], spacing: 0.05, depth: 0.5}
wind: {kind: uniform, velocity: [0.3, -0.1]}
gas: {kind: gaussian_plume, intensity: 0.1, sources: [{position: [0.3, 0.7], rate: 1.0e-6}]}
robots:
  - {name: walkers, count: 2, trials: 2, reach: 0, start: {kind: area, low: [0.3, 0.3], high: [1.7, 1.2]},
     algorithm: {kind: random_walk}, sensors: {wind: {kind: ideal}}}
maps: [{kind: wind_gmrf, cell: 0.25}, {kind: inverse_distance}]
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wind")
    (folder / "wind.yaml").write_text(SCENARIO)
    return tp.simulate(folder / "wind.yaml", out=folder / "run", recording=False, report=True)


def test_a_uniform_wind_is_found_exactly(run):
    wind = run.maps[0]
    assert wind.estimate.dims == wind.truth.dims == wind.variance.dims == ("trial", "y", "x", "component")
    assert wind.estimate.attrs["units"] == "m s-1"
    np.testing.assert_allclose(wind.truth.values, np.broadcast_to([0.3, -0.1], wind.truth.shape), rtol=1e-5)
    np.testing.assert_allclose(wind.estimate.values, wind.truth.values, rtol=1e-4)
    assert run.maps[1].estimate.dims == maps_file.WHOLE
    result = run.result["maps"][0]
    assert result["error_m_s"] < 1e-4
    assert result["direction_error_deg"] < 0.01
    assert result["known_fraction"] == 1.0
    assert result["mean_wind"]["time_s"] == pytest.approx([5.0, 10.0])
    assert "mae_ppm" not in result


def test_the_report_has_both_kinds_of_maps(run):
    assert [each.is_of_wind for each in maps_of(run.folder)] == [True, False]
    page = (run.folder / "report.html").read_text()
    assert "Maps of the wind at the end" in page
    assert "Maps at the end" in page


def test_errors_of_speed_and_direction():
    truth = np.zeros((3, 1, 2))
    truth[:, 0] = [[1.0, 0.0], [0.0, 2.0], [np.nan, np.nan]]
    estimate = np.full((2, 3, 1, 2), np.nan)
    estimate[0, :, 0] = [[0.0, 1.0], [0.0, 5.0], [9.0, 9.0]]
    error, direction, known = scores.wind_score(estimate, truth)
    np.testing.assert_allclose(error, [(np.sqrt(2.0) + 3.0) / 2, np.nan])
    np.testing.assert_allclose(direction, [90.0 * 1.0 / 3.0, np.nan])  # 90° where a third of the wind is
    np.testing.assert_allclose(known, [1.0, 0.0])


def test_logs_make_no_maps_of_the_wind(run):
    with pytest.raises(ReadingsError, match=r"--map\.kind: wind_gmrf"):
        tp.maps(run, {"kind": "wind_gmrf"})


def test_walls_and_openings_of_a_computed_flow_are_the_edges():
    text = SCENARIO.replace(
        "{kind: uniform, velocity: [0.3, -0.1]}",
        "{kind: cfd, openings: [{kind: inlet, face: x-, speed: 0.2, center: [0.5], size: [0.5]}, "
        "{kind: outlet, face: y+}]}",
    )
    scenario = tp.Scenario.from_dict(yaml.safe_load(text))
    along = (np.arange(6) + 0.5) * 0.25
    np.testing.assert_array_equal(
        scenario.passes_edge(0, 0, along, 0.25), [False, True, True, False, False, False]
    )
    assert not scenario.passes_edge(0, 1, along, 0.25).any()
    assert not scenario.passes_edge(1, 0, along, 0.25).any()
    assert scenario.passes_edge(1, 1, along, 0.25).all()
