import numpy as np
import pandas as pd
import pytest

from taichi_plume.validation import red_vapor
from taichi_plume.validation.searches import scenario_of


@pytest.fixture
def table():
    """Made-up landscape: wind against x that veers behind x = 0 at small |y|, and a plume around y = -0.3 m."""
    x, y, z = (
        axis.ravel()
        for axis in np.meshgrid(np.linspace(-1.14, 1.14, 5), np.linspace(-1.14, 1.14, 9), [0.3, 0.9])
    )
    veer = np.where((x < 0) & (np.abs(y) < 0.3), 0.2, 0.0)
    gas = np.where(x < 0, 5.0 * np.exp(-((y + 0.3) ** 2) / 0.02), 0.0)
    return pd.DataFrame(
        {"x": x, "y": y, "z": z, "u": -1.5 * np.cos(veer), "v": 1.5 * np.sin(veer), "w": 0 * x, "gas": gas}
    )


def test_directions_and_zeros_of_the_probes_are_taken_out(table, tmp_path):
    raw = table.copy()
    angle = np.where(raw["z"] > 0.5, 0.1, -0.2) + 0.05 * raw["x"]  # of each line, about the vertical
    raw["u"], raw["v"] = (
        np.cos(angle) * table["u"] - np.sin(angle) * table["v"],
        np.sin(angle) * table["u"] + np.cos(angle) * table["v"],
    )
    raw["gas"] += np.where(raw["z"] > 0.5, 0.4, -0.1) + 0.3 * raw["x"]
    names = {name: column for column, name in red_vapor.COLUMNS.items()}
    raw.rename(columns=names).to_csv(tmp_path / "a.csv", index=False)
    found = red_vapor.prepared(tmp_path / "a.csv")
    for name in table:
        assert found[name].to_numpy() == pytest.approx(table[name].to_numpy(), abs=1e-3)
    raw.drop(columns=["u", "v", "w"]).rename(columns=names).to_csv(tmp_path / "b.csv", index=False)
    assert red_vapor.prepared(tmp_path / "b.csv")["gas"].to_numpy() == pytest.approx(table["gas"], abs=1e-3)


def test_gas_that_is_the_measured_one_in_another_unit_agrees(table):
    found = red_vapor.agreement_of_gas(table, 1e-3 * table["gas"].to_numpy(), table["u"].to_numpy())
    assert found["FAC2"] == 1.0
    assert found["fractional bias"] == pytest.approx(0.0, abs=1e-12)
    assert found["NMSE"] == pytest.approx(0.0, abs=1e-12)


def test_the_wind_blows_along_our_x():
    assert red_vapor.placed([(red_vapor.UPSTREAM, 0.0)])[0] == pytest.approx([0.0, red_vapor.WIDTH / 2])
    behind = red_vapor.placed([(0.4, 0.2)])[0] - red_vapor.placed([(0.0, 0.0)])[0]
    assert behind == pytest.approx([-0.4, -0.2])
    turned = red_vapor.placed([(0.4, 0.2)], 90.0)[0] - red_vapor.placed([(0.0, 0.0)], 90.0)[0]
    assert turned == pytest.approx([0.2, -0.4])


def test_the_landscape_is_a_scenario(table):
    table = table[table["z"] > 0.5]  # above the bodies
    points = np.column_stack([red_vapor.placed(table[["x", "y"]].to_numpy()), table["z"]])
    checked = scenario_of(red_vapor.scenario(points, red_vapor.inflow(table), 0.06, turned_deg=45.0))
    assert checked.probes is not None
    assert checked.probes.size == len(table)
