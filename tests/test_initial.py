"""Wind, gas and heat that begin as a scenario's formulas or a film say."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pydantic import ValidationError

from taichi_plume.assembly.assemble import build
from taichi_plume.assembly.preparation import checked
from taichi_plume.engine.program import compiled, ensure_started
from taichi_plume.execution.film_output import Filming
from taichi_plume.grid.state import State
from taichi_plume.scenario.initial_conditions import units_of
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.outputs import Fields
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scoring import trials as scores

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

DRIFT, VISCOSITY, WIDTH = 0.3, 0.005, 0.08
BOX: dict[str, Any] = yaml.safe_load(f"""
duration: 1.0
tick: 0.5
domain: {{size: [2, 2], spacing: 0.125}}
wind:
  kind: cfd
  viscosity: {VISCOSITY}
  turbulence: {{kind: none}}
  openings: [{{kind: periodic, axis: x}}, {{kind: periodic, axis: "y"}}]
  initial: {{velocity: ["{DRIFT} + sin(pi*x)*cos(pi*y)", "-cos(pi*x)*sin(pi*y)"]}}
gas:
  kind: eulerian
  sources: [{{position: [0.4, 1], rate: 1.0e-6, radius: 0.2}}]
  initial: {{concentration: "1e-5*(2 + sin(pi*x))"}}
""")
ROOM: dict[str, Any] = yaml.safe_load("""
duration: 0.5
domain: {size: [1.6, 1.2], spacing: 0.1}
obstacles: [{kind: cylinder, center: [0.8, 0.6], radius: 0.25}]
wind:
  kind: cfd
  openings: [{kind: inlet, face: x-, speed: 0.2}, {kind: outlet, face: x+}]
  initial: {velocity: ["0.2/hypot(x - 0.8, y - 0.6)", 0]}
  buoyancy:
    gravity: [0, -9.81]
    solutal: false
    heat: {initial: {temperature: "300 + 10*log(hypot(x - 0.8, y - 0.6)/0.2)"}}
gas: {kind: eulerian, sources: [{position: [0.3, 0.6], rate: 0}], initial: {concentration: "1e-5*x"}}
""")


def assembled(model: dict, folder: Path = Path(), **changes: Any) -> Any:
    ensure_started()
    return build(checked(Scenario.model_validate(model | changes), folder))


def velocities(sim: Any) -> list[np.ndarray]:
    return [sim.grid.read(one).astype(float) for one in sim.wind.u]


def test_a_drifting_vortex_is_its_closed_form_to_second_order():
    errors = []
    for n in (16, 32):
        sim = assembled(BOX, domain={"size": [2, 2], "spacing": 2 / n})
        sim.run()
        x, y = np.meshgrid(np.arange(n) * 2 / n, (np.arange(n) + 0.5) * 2 / n, indexing="ij")
        decay = np.exp(-2 * VISCOSITY * np.pi**2)
        exact = DRIFT + np.sin(np.pi * (x - DRIFT)) * np.cos(np.pi * y) * decay
        errors.append(np.sqrt(np.mean((velocities(sim)[0] - exact) ** 2)))
        budget = sim.gas.gases[0].budget()
        assert budget["initial_kg"] == pytest.approx(8e-5, rel=1e-5)
        assert budget["in_domain_kg"] == pytest.approx(8e-5 + 1e-6, rel=1e-5)
    assert errors[0] < 0.02
    assert np.log2(errors[0] / errors[1]) > 1.9


def test_a_puff_drifts_with_a_uniform_wind():
    gas = {
        "kind": "eulerian",
        "species": {"name": "gas", "molar_mass": 0.03, "diffusivity": 0.002},
        "sources": [{"position": [0.1, 0.1], "rate": 0}],
        "initial": {"concentration": f"1e-5*exp(-((x - 0.8)**2 + (y - 1)**2)/{2 * WIDTH})"},
    }
    wind = {"kind": "uniform", "velocity": [DRIFT, 0]}
    sim = assembled(BOX, wind=wind, gas=gas, domain={"size": [2, 2], "spacing": 0.04})
    sim.run()
    x, y = np.moveaxis(sim.grid.centers(), -1, 0)
    wide = WIDTH + 2 * 0.002
    exact = 1e-5 * WIDTH / wide * np.exp(-((x - 0.8 - DRIFT) ** 2 + (y - 1) ** 2) / (2 * wide))
    inner = np.hypot(x - 1.1, y - 1) < 0.6  # clean air comes in at the face
    np.testing.assert_allclose(sim.gas.gases[0].cells(1.0)[inner], exact[inner], atol=2e-7)


def test_what_lies_in_obstacles_does_not_count_and_a_reset_compiles_nothing():
    sim = assembled(ROOM)
    solver, flow = sim.gas.gases[0], sim.wind
    x, y = np.moveaxis(sim.grid.centers(), -1, 0)
    solid = sim.air.solid
    assert solid.any()
    np.testing.assert_allclose(solver.cells(0.0), np.where(solid, 0.0, 1e-5 * x), rtol=1e-6)
    away = np.maximum(np.hypot(x - 0.8, y - 0.6), 1e-9)
    warmth = np.where(solid, 0.0, 300 - 298.15 + 10 * np.log(away / 0.2))
    np.testing.assert_allclose(sim.grid.read(flow.heat.theta), warmth, rtol=1e-5, atol=1e-4)
    assert flow.diagnostics()["max_divergence"] < 1e-3
    assert all(np.all(one[sim.air.area[d][:16, :12] == 0.0] == 0.0) for d, one in enumerate(velocities(sim)))
    state = State(sim)
    before = state.save()
    sim.run()
    heat, room = flow.heat.budget(), solver.budget()
    assert heat["initial_J"] == pytest.approx(heat["in_air_J"] + heat["outflow_J"], rel=1e-4)
    assert room["initial_kg"] == pytest.approx(room["in_domain_kg"] + room["outflow_kg"], rel=1e-4)
    kernels = compiled()
    sim.reset()
    after = State(sim).save()
    assert all(np.array_equal(before[key], after[key], equal_nan=True) for key in state.paths)
    other = Scenario.model_validate(ROOM | {"gas": ROOM["gas"] | {"initial": {"concentration": "1e-5*y"}}})
    sim.reset(other)
    np.testing.assert_allclose(sim.gas.gases[0].cells(0.0), np.where(solid, 0.0, 1e-5 * y), rtol=1e-6)
    assert compiled() == kernels


def test_a_film_goes_on_from_one_of_its_moments_on_any_grid(tmp_path):
    sim = assembled(BOX)
    film = Filming(sim, tmp_path / "fields.zarr", Fields())
    film.start()
    film.shoot(sim)
    first = [*velocities(sim), sim.gas.gases[0].cells(0.0)]
    sim.run()
    film.shoot(sim)
    last = [*velocities(sim), sim.gas.gases[0].cells(1.0)]
    del film, sim  # the next ones find their kernels in the cache
    begin = {"film": "fields.zarr", "at": 0.25}
    wind, gas = BOX["wind"] | {"initial": begin}, BOX["gas"] | {"initial": begin}
    again = assembled(BOX, tmp_path, wind=wind, gas=gas)
    for now, a, b in zip([*velocities(again), again.gas.gases[0].cells(0.0)], first, last, strict=True):
        np.testing.assert_allclose(now, 0.75 * a + 0.25 * b, atol=1e-4 * np.abs(a).max())
    held, fastest = again.gas.gases[0].budget()["initial_kg"], np.abs(velocities(again)[0]).max()
    del again
    finer = assembled(BOX, tmp_path, wind=wind, gas=gas, domain={"size": [2, 2], "spacing": 2 / 32})
    assert held == pytest.approx(finer.gas.gases[0].budget()["initial_kg"], rel=1e-3)
    assert np.abs(velocities(finer)[0]).max() == pytest.approx(fastest, rel=0.02)
    for change, reported in [
        ({"film": "fields.zarr", "at": 7}, r"wind.initial.at: 7 s is not in .*, which shows 0 to 1 s"),
        ({"film": "none.zarr"}, r"wind.initial.film: .*none.zarr: does not exist"),
    ]:
        with pytest.raises(ScenarioError, match=reported):
            assembled(BOX, tmp_path, wind=BOX["wind"] | {"initial": change})
    with pytest.raises(ScenarioError, match=r"shows 2 x 2 m, the domain is 3 x 2 m"):
        assembled(BOX, tmp_path, wind=wind, domain={"size": [3, 2], "spacing": 0.1})


@pytest.mark.parametrize(
    ("section", "initial", "reported"),
    [
        ("wind", {"velocity": ["1/x", 0]}, r"wind.initial.velocity\[0\]: at \(0, 0.0625\) m it is inf m/s"),
        ("wind", {"velocity": ["z", 0]}, "wind.initial: has z"),
        ("wind", {"velocity": [0, 0, 0]}, "wind.initial.velocity: has 3 numbers, a 2-D run takes 2 here"),
        (
            "gas",
            {"concentration": "1 - x"},
            r"gas.initial.concentration: at \(1.062, 0.0625\) m it is -0.0625",
        ),
        ("gas", {}, "takes concentration or film, got neither"),
        ("gas", {"concentration": 1, "film": "a.zarr"}, "takes concentration or film, got both"),
        ("gas", {"concentration": "1", "at": 3}, "at: is a time of a film"),
        ("gas", {"concentration": "os.system('ls')"}, "is not arithmetic"),
        ("gas", {"concentration": "-3 ppm"}, "gas.initial.concentration: at .* it is -"),
        ("gas", {"concentration": "420 ppq"}, "'420 ppq' is no formula; allowed: .* ppm"),
        ("gas", {"concentration": "420 ppm * exp(-x)"}, "'420 ppm .* is no formula; allowed: .* ppm"),
        ("gas", {"concentration": "3e6 ppm"}, "at most 1e.06 ppm"),
    ],
)
def test_what_cannot_begin_so_is_reported(section, initial, reported):
    with pytest.raises((ScenarioError, ValidationError), match=reported):
        checked(Scenario.model_validate(BOX | {section: BOX[section] | {"initial": initial}}), Path())


@pytest.mark.parametrize(
    ("concentration", "ppm"),
    [("420 ppm", 420.0), ("5 ppb", 5e-3), ("2e3 ppt", 2e-3), ("0.04 %", 400.0), ("100*ppm*(1 + x)", 200.0)],
)
def test_a_concentration_may_be_given_in_ppm(concentration, ppm):
    gas = BOX["gas"] | {"species": "carbon_dioxide", "initial": {"concentration": concentration}}
    scenario = checked(Scenario.model_validate(BOX | {"gas": gas}), Path()).scenario
    ((_, model),) = scenario.gases
    (found,) = model.initial.values(np.array([[1.0, 1.0]]), units_of(model.vapour))
    assert found[0] * model.vapour.ppm_per_density == pytest.approx(ppm, rel=1e-6)


def test_the_air_begins_with_the_ppm_of_its_gas():
    gas = BOX["gas"] | {"species": "methane", "initial": {"concentration": "2 ppm"}}
    gas["sources"] = [BOX["gas"]["sources"][0] | {"rate": 0}]
    sim = assembled(BOX, gas=gas, wind={"kind": "uniform", "velocity": [0, 0]})
    assert scores.true_gas(sim, 0.5, (4, 4)) == pytest.approx(2.0, rel=1e-5)
