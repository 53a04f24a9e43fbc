import numpy as np
import pytest

from taichi_plume.validation import plume_edge
from taichi_plume.validation.plume_edge import DISTANCES, FIRST, LEAST, Records
from taichi_plume.validation.published_data import VARIABLE, MissingDataError
from taichi_plume.validation.searches import scenario_of


def test_statistics_of_samples_with_dye_in_a_tenth_of_them():
    c, v = np.zeros(1000), np.zeros(1000)
    c[::10], v[::10] = 0.02, 1.0
    found = plume_edge.statistics(c, -v, v, LEAST)
    assert found.mean == pytest.approx(0.002)
    assert found.present == pytest.approx(0.1)
    assert found.intensity == pytest.approx(3.0)  # the root of 1/0.1 - 1
    assert (found.v_c, found.u_c) == pytest.approx((1.0, -1.0))


def test_the_distance_is_where_the_first_point_has_the_measured_share():
    n, shares = 10_000, np.array([0.03, 0.05, 0.08, 0.1, 0.12, 0.15, 0.2, 0.25])
    gas = np.zeros((len(DISTANCES), 2, n))
    for k, share in enumerate(shares):
        gas[k, 0, : round(share * n)] = 7.0  # ppm; the unit does not matter
        gas[k, 1, : round(0.5 * share * n)] = 7.0
    wind = np.random.default_rng(1).standard_normal((2, *gas.shape))
    distance, edges, seen = plume_edge.at_edge(Records(gas, *wind))
    assert distance == pytest.approx(DISTANCES[2] + 0.25 * (DISTANCES[3] - DISTANCES[2]), rel=1e-6)
    assert seen == pytest.approx(shares)
    first, second = edges.values()
    assert (first.mean, first.present) == pytest.approx((FIRST.mean, FIRST.present))
    assert (second.mean, second.present) == pytest.approx((0.5 * FIRST.mean, 0.5 * FIRST.present))
    assert np.isnan(plume_edge.at_edge(Records(gas[:2], *wind[:, :2]))[0])


def test_the_unit_gives_the_mean_of_what_is_above_the_threshold():
    gas = np.random.default_rng(3).exponential(size=5000) * (np.arange(5000) % 10 == 0)
    unit = plume_edge.unit_of(gas, FIRST.mean, LEAST)
    assert np.where(unit * gas >= LEAST, unit * gas, 0.0).mean() == pytest.approx(FIRST.mean)
    assert plume_edge.unit_of(np.zeros(5), FIRST.mean, LEAST) == 0.0


def test_a_file_of_the_data_set_is_read(tmp_path, monkeypatch):
    rows = np.column_stack([np.zeros(400), *np.random.default_rng(2).standard_normal((3, 400))])
    rows[:40, 0] = 0.01
    text = "% 1000 samples\n% C, U, V, W\nC,U,V,W\n" + "\n".join(",".join(map(str, row)) for row in rows)
    (tmp_path / "plume_edge").mkdir()
    for name in plume_edge.FILES.values():
        (tmp_path / name).write_text(text)
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    found = plume_edge.of_files(1)
    assert found["share of time with dye, 18.5 mm"].mean == pytest.approx(0.1)
    v_c = found["correlation of v and c, 16.1 mm"].mean
    assert v_c == pytest.approx(np.corrcoef(rows[:, 2], rows[:, 0])[0, 1])
    monkeypatch.delenv(VARIABLE)
    with pytest.raises(MissingDataError, match="PlumeData1"):
        plume_edge.of_files(1)


def test_the_tunnel_is_a_scenario_with_the_point_above_the_axis():
    checked = scenario_of(plume_edge.scenario(1, 0.75))
    assert checked.probes is not None
    assert checked.probes.size == 4 * len(DISTANCES) * 4 * 2
    away = np.array(checked.probes.points[1].at) - plume_edge.SOURCES[0]
    assert away / plume_edge.SCALE == pytest.approx([0.1, 0.0185, 0.0])
