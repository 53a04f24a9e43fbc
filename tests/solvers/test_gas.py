import numpy as np
import pytest

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import concentration_at
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.gases import EulerianGas
from taichi_plume.scenario.sources import Source
from taichi_plume.scenario.species import SPECIES
from taichi_plume.scenario.winds import CfdWind, UniformWind
from taichi_plume.solvers.emission import Emission
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.prescribed import PrescribedWind
from taichi_plume.solvers.uniform import UniformSolver

pytestmark = pytest.mark.usefixtures("taichi")


def arena(shape=(40, 30), rate=2e-5, seed=0, **source):
    grid = Grid(shape, 4.0 / shape[0], depth=0.5)
    solid = np.zeros(shape, bool)
    solid[12:16, 10:16] = True
    openings = [
        {"kind": "honeycomb", "face": "x-", "speed": 0.7},
        {"kind": "honeycomb", "face": "x+"},
    ]
    flow = FlowSolver(
        CfdWind.model_validate({"kind": "cfd", "openings": openings}), grid, Air.of(solid, grid)
    )
    position = (0.6, 1.3, 0.25)[: len(shape)]
    model = EulerianGas.model_validate(
        {"kind": "eulerian", "sources": [{"position": position, "rate": rate} | source]}
    )
    return grid, solid, flow, EulerianSolver(model, grid, flow, Air.of(solid, grid), 0.0, seed)


@pytest.mark.parametrize("shape", [(40, 30), (40, 30, 5)])
def test_mass_is_accounted_for_and_never_negative(shape):
    _, _, flow, gas = arena(shape)
    t = 0.0
    while t < 8.0:
        dt = min(0.1, flow.stable_dt())
        flow.advance(t, dt)
        gas.advance(t, dt)
        t += dt
        assert gas.least() >= 0.0
    budget = gas.budget()
    missing = budget["emitted_kg"] - budget["in_domain_kg"] - budget["outflow_kg"]
    assert budget["emitted_kg"] == pytest.approx(2e-5 * t, rel=1e-6)
    assert budget["outflow_kg"] > 0.1 * budget["emitted_kg"]
    assert abs(missing) <= 1e-6 * budget["emitted_kg"]


def test_no_mass_is_lost_in_thousands_of_steps():
    """In a closed room most cells change by less than f32 can tell in a step; nothing leaves to dilute the errors."""
    grid = Grid((32, 32), 1.0 / 32)

    def roll(x):
        (s, c), (r, d) = ((np.sin(np.pi * x[..., a]), np.cos(np.pi * x[..., a])) for a in range(2))
        return np.round(np.stack([s * d, -c * r], axis=-1), 9)  # 0 at the walls

    keys = {"position": (0.3, 0.4), "rate": 2e-5, "radius": 0.1, "stop": 10.0}
    model = EulerianGas.model_validate({"kind": "eulerian", "sources": [keys, keys | {"rate": 1e-6}]})
    gas = EulerianSolver(model, grid, PrescribedWind(roll, grid), Air.everywhere(grid))
    for n in range(4000):
        gas.advance(0.01 * n, 0.01)
    budget = gas.budget()
    assert budget["emitted_kg"] == pytest.approx(2.1e-4, rel=1e-12)
    assert budget["outflow_kg"] == pytest.approx(0.0, abs=1e-20)
    assert budget["in_domain_kg"] == pytest.approx(2.1e-4, rel=2e-8)
    assert gas.least() >= 0.0


def test_well_mixed_gas_stays_well_mixed_away_from_the_inflow():
    grid, solid, flow, gas = arena(rate=0.0)
    gas.start_from(lambda x: np.ones(x.shape[:-1]))
    for n in range(10):
        flow.advance(0.01 * n, 0.01)
        gas.advance(0.01 * n, 0.01)
    c = grid.inner(gas.c.to_numpy())
    np.testing.assert_allclose(c[20:][~solid[20:]], 1.0, rtol=1e-5)


def test_gas_stays_out_of_obstacles():
    grid, solid, flow, gas = arena()
    for n in range(100):
        flow.advance(0.02 * n, 0.02)
        gas.advance(0.02 * n, 0.02)
    assert np.all(grid.inner(gas.c.to_numpy())[solid] == 0.0)


def test_a_layer_of_cells_is_the_plane_gas():
    fields = []
    for shape in ((40, 30), (40, 30, 1)):
        grid = Grid(shape, 0.1, depth=0.1)
        wind = UniformSolver(UniformWind(kind="uniform", velocity=(0.3, 0.1, 0.0)[: len(shape)]), grid)
        model = EulerianGas.model_validate(
            {
                "kind": "eulerian",
                "sources": [{"position": (1.0, 1.0, 0.05)[: len(shape)], "rate": 1e-5, "radius": 0.15}],
            }
        )
        gas = EulerianSolver(model, grid, wind, Air.everywhere(grid))
        for n in range(20):
            gas.advance(0.1 * n, 0.1)
        fields.append(grid.inner(gas.c.to_numpy()).reshape(40, 30))
    # a ball's cells weigh a little differently from a disc's
    assert fields[1].sum() == pytest.approx(fields[0].sum(), rel=1e-5)


def test_sampling_beside_an_obstacle_sees_only_air():
    _, solid, _, gas = arena(rate=0.0)
    gas.start_from(lambda x: np.where(solid, 0.0, 1.0))
    beside = np.array([[1.19, 1.3], [1.605, 1.21], [0.01, 0.01], [3.99, 2.99]])
    np.testing.assert_allclose(concentration_at(gas, beside, 0.0), 1.0, rtol=1e-5)


def begun(source, t=0.0, seed=0) -> Emission:
    emission = Emission("a")
    emission.begin(source, t, seed)
    return emission


def test_pulses_emit_their_share_and_differ_by_seed():
    source = Source.model_validate(
        {"position": [1, 1], "rate": 1.0, "puffing": {"pulse": 1.0, "pause": 3.0, "spread": 0.5}}
    )
    emission = begun(source, seed=1)
    masses = np.array([emission.mass(0.1 * n, 0.1) for n in range(40_000)])
    assert masses.sum() == pytest.approx(1000.0, rel=0.05)
    assert np.all((masses >= 0) & (masses <= 0.1 + 1e-9))
    other = begun(source, seed=2)
    assert any(other.mass(0.1 * n, 0.1) != masses[n] for n in range(200))


def test_a_source_starts_and_stops():
    source = Source.model_validate({"position": [1, 1], "rate": 0.2, "start": 1.0, "stop": 3.5})
    emission = begun(source, -10.0)
    assert sum(emission.mass(t, 0.3) for t in np.arange(-3.0, 6.0, 0.3)) == pytest.approx(0.5)


def test_ppm_of_the_vapours():
    """1 ppm at 25 °C and 1 atm, mg/m³, from tables of occupational hygiene."""
    assert 1e6 / SPECIES["ethanol"].ppm_per_density == pytest.approx(1.883, rel=1e-3)
    assert 1e6 / SPECIES["acetone"].ppm_per_density == pytest.approx(2.374, rel=1e-3)
