"""The helium box: its holes let through what holes do, its closed forms agree with each other. The runs, of some
minutes, are left to the command.
"""

from math import sqrt
from typing import Any

import numpy as np
import pytest

from taichi_plume.assembly.assemble import assemble
from taichi_plume.validation import helium_box as case
from taichi_plume.validation.searches import scenario_of


@pytest.mark.parametrize("cell", [cell for cell, _ in case.RUNS])
@pytest.mark.parametrize("edge", [case.LOW, case.HIGH])
def test_openings_are_whole_cells_around_the_holes_and_pass_as_much(cell, edge):
    one = case.opening(edge, cell)
    for middle, size, low in zip(one["center"], one["size"], (0.75, edge), strict=True):
        assert middle - 0.5 * size <= low + 1e-9
        assert low + case.SIDE <= middle + 0.5 * size + 1e-9
        assert (middle - 0.5 * size) / cell == pytest.approx(round((middle - 0.5 * size) / cell), abs=1e-6)
        assert size / cell == pytest.approx(round(size / cell), abs=1e-6)
        assert size < case.SIDE + 2.0 * cell
    speed = sqrt(2.0 * 3.0 / one["loss_coefficient"])  # at 3 Pa m³/kg
    assert np.prod(one["size"]) * speed == pytest.approx(0.654 * 0.0215**2 * sqrt(2.0 * 3.0), rel=1e-3)


@pytest.mark.parametrize("cell", [cell for cell, _ in case.RUNS])
def test_scenarios_can_be_run_and_measure_where_it_was_measured(cell):
    scenario = scenario_of(case.scenario(cell, 600.0))
    assert scenario.probes is not None
    places = np.concatenate([one.places for one in scenario.probes.points])
    np.testing.assert_allclose(places, [(0.375, 0.375, z) for z in case.HEIGHTS])
    (source,) = scenario.gas.sources  # pyright: ignore[reportAttributeAccessIssue]
    assert source.rate is not None
    litres = source.rate / 4.0026e-3 * 24.465 * 60.0  # of a mole at 25 °C
    assert litres == pytest.approx(3.54, rel=1e-3)


def test_the_two_closed_forms_agree_on_little_helium(monkeypatch):
    assert case.mixed(True) > case.mixed(False)
    monkeypatch.setattr(case, "FLOW", 1e-4 * case.FLOW)
    assert case.mixed(True) == pytest.approx(case.mixed(False), rel=1e-3)


def test_deeper_holes_let_through_more():
    """A hole in a thin sheet has the 0.6 of textbooks (0.595 to 0.61), a short tube 0.8 (Streeter, Fluid Mechanics)."""
    assert 0.59 < case.discharge(0.0) < 0.61
    assert case.discharge(0.0) < case.discharge(0.6) < case.discharge(1.4)
    assert case.discharge(1.4) == pytest.approx(0.8, abs=0.02)


def test_a_mixed_box_asks_for_the_coefficient_of_its_holes():
    percent = np.full(len(case.HEIGHTS), 100.0 * case.mixed(False))
    assert case.asked(percent) == pytest.approx(case.DISCHARGE)


def test_what_was_measured_rises_with_height_and_has_the_mean_that_is_asked_for():
    for percent in case.MEASURED.values():
        assert len(percent) == len(case.HEIGHTS)
        assert case.summary(np.array(percent))[case.RISE] > 0.0
    least, most = (getattr(case.EXPECTED[f"{case.MEAN}, after 4 h"], end) for end in ("least", "most"))
    assert 0.5 * (least + most) == pytest.approx(96.11 / 7, abs=0.01)
    assert most / least == pytest.approx(1.15 / 0.85, rel=1e-3)


@pytest.mark.slow
@pytest.mark.usefixtures("taichi")
def test_light_air_drives_itself_through_two_holes():
    """A box full of 15 % of helium: as much comes in below as goes out above, C_d A √(2 g' H/(1 + rho)) of two equal
    holes, rho the density of the mixture over that of air.
    """
    cell, fraction, seconds = 0.125, 0.15, 16.0
    density = fraction * case.HELIUM * case.PRESSURE / (case.GAS_CONSTANT * case.TEMPERATURE)
    data: dict[str, Any] = case.scenario(cell, seconds) | {"tick": 0.05}
    data["gas"]["initial"] = {"concentration": density}
    data["gas"]["sources"][0]["rate"] = 0.0
    sim = assemble(scenario_of(data))
    sim.run()
    g, (_, ny, nz) = sim.grid.ghost, sim.grid.shape
    speed = sim.wind.u[0].to_numpy()[g, g : g + ny, g : g + nz]  # pyright: ignore[reportAttributeAccessIssue]
    comes, goes = cell**2 * speed[:, 0].sum(), -(cell**2) * speed[:, -1].sum()
    apart = case.opening(case.HIGH, cell)["center"][1] - case.opening(case.LOW, cell)["center"][1]
    lighter = case.LIGHTER * fraction
    expected = 0.654 * 0.0215**2 * sqrt(2.0 * lighter * 9.81 * apart / (2.0 - lighter))
    assert comes == pytest.approx(expected, rel=0.03)
    assert goes == pytest.approx(comes, rel=1e-3)
