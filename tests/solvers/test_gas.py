import numpy as np
import pytest
from rooms import blocks, eulerian, march

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import concentration_at
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.gases import EulerianGas
from taichi_plume.scenario.sources import Source
from taichi_plume.scenario.species import SPECIES
from taichi_plume.scenario.winds import UniformWind
from taichi_plume.solvers.emission import Emission
from taichi_plume.solvers.gas import EulerianSolver
from taichi_plume.solvers.prescribed_wind import PrescribedWind
from taichi_plume.solvers.uniform_wind import UniformSolver

pytestmark = pytest.mark.usefixtures("taichi")


ROLL = Grid((32, 32), 1.0 / 32)


def rolling(sources: list[dict], seed: int = 0) -> EulerianSolver:
    """Gas in a closed room in which the air goes round."""

    def roll(x):
        (s, c), (r, d) = ((np.sin(np.pi * x[..., a]), np.cos(np.pi * x[..., a])) for a in range(2))
        return np.round(np.stack([s * d, -c * r], axis=-1), 9)  # 0 at the walls

    air = Air.everywhere(ROLL)
    return EulerianSolver(in_a_roll(sources), ROLL, PrescribedWind(roll, ROLL), air, 0.0, seed)


def in_a_roll(sources: list[dict], **keys) -> EulerianGas:
    return EulerianGas.model_validate({"kind": "eulerian", "sources": sources} | keys)


PLACED = {"position": (0.3, 0.4), "rate": 2e-5, "radius": 0.1}


def test_no_mass_is_lost_in_thousands_of_steps(taichi):
    """In a closed room most cells change by less than f32 can tell in a step; nothing leaves to dilute the errors."""
    keys = PLACED | {"stop": 10.0}
    gas = rolling([keys, keys | {"rate": 1e-6}])
    march(4000, 0.01, gas)
    budget = gas.budget()
    assert budget["emitted_kg"] == pytest.approx(2.1e-4, rel=1e-12)
    assert budget["outflow_kg"] == pytest.approx(0.0, abs=1e-20)
    assert budget["in_domain_kg"] == pytest.approx(2.1e-4, rel=2e-8)
    assert gas.least() >= 0.0


def test_a_layer_of_cells_is_the_plane_gas():
    fields = []
    for shape in ((40, 30), (40, 30, 1)):
        grid = Grid(shape, 0.1, depth=0.1)
        wind = UniformSolver(UniformWind(kind="uniform", velocity=(0.3, 0.1, 0.0)[: len(shape)]), grid)
        model = eulerian((1.0, 1.0, 0.05)[: len(shape)], 1e-5, radius=0.15)
        gas = EulerianSolver(model, grid, wind, Air.everywhere(grid))
        march(20, 0.1, gas)
        fields.append(gas.cells(2.0).reshape(40, 30))
    # a ball's cells weigh a little differently from a disc's
    assert fields[1].sum() == pytest.approx(fields[0].sum(), rel=1e-5)


def test_a_source_needs_air_and_sampling_beside_an_obstacle_sees_only_air():
    grid = Grid((40, 30), 0.1, depth=0.5)
    solid = blocks(grid.shape, np.s_[12:16, 10:16])
    model = eulerian((0.6, 1.3))
    gas = EulerianSolver(model, grid, PrescribedWind(np.zeros_like, grid), Air.of(solid, grid))
    gas.start_from(lambda x: np.where(solid, 0.0, 1.0))
    beside = np.array([[1.19, 1.3], [1.605, 1.21], [0.01, 0.01], [3.99, 2.99]])
    np.testing.assert_allclose(concentration_at(gas, beside, 0.0), 1.0, rtol=1e-5)
    inside = model.sources[0].model_copy(update={"position": (1.4, 1.3)})
    with pytest.raises(ValueError, match=r"sources\[0\]\.position: is not in the air"):
        EulerianSolver(
            model.model_copy(update={"sources": (inside,)}),
            grid,
            PrescribedWind(np.zeros_like, grid),
            Air.of(solid, grid),
        )


def test_pulses_emit_their_share_and_differ_by_seed():
    source = Source.model_validate(
        {"position": [1, 1], "rate": 1.0, "puffing": {"pulse": 1.0, "pause": 3.0, "spread": 0.5}}
    )
    emission = Emission("a", source, 0.0, 1)
    masses = np.array([emission.mass(0.1 * n, 0.1) for n in range(40_000)])
    assert masses.sum() == pytest.approx(1000.0, rel=0.05)
    assert np.all((masses >= 0) & (masses <= 0.1 + 1e-9))
    other = Emission("a", source, 0.0, 2)
    assert any(other.mass(0.1 * n, 0.1) != masses[n] for n in range(200))


def test_a_source_starts_and_stops():
    source = Source.model_validate({"position": [1, 1], "rate": 0.2, "start": 1.0, "stop": 3.5})
    emission = Emission("a", source, -10.0, 0)
    assert sum(emission.mass(t, 0.3) for t in np.arange(-3.0, 6.0, 0.3)) == pytest.approx(0.5)


def test_ppm_of_the_vapours():
    """1 ppm at 25 °C and 1 atm, mg/m³, from tables of occupational hygiene."""
    assert 1e6 / SPECIES["ethanol"].ppm_per_density == pytest.approx(1.883, rel=1e-3)
    assert 1e6 / SPECIES["acetone"].ppm_per_density == pytest.approx(2.374, rel=1e-3)


@pytest.mark.parametrize("shape", [(1, 9), (2, 9), (9, 2), (2, 3, 4)])
def test_gas_stays_even_along_thin_periodic_axes(shape):
    grid = Grid(shape, 0.1, periodic=(True,) * len(shape), depth=0.1)
    wind = PrescribedWind(lambda x: np.full(x.shape, 0.3), grid)
    gas = EulerianSolver(eulerian((0.05,) * len(shape)), grid, wind, Air.everywhere(grid))
    thin = int(np.argmin(shape))
    gas.start_from(lambda x: 1.0 + np.sin(2 * np.pi * np.delete(x, thin, axis=-1).sum(axis=-1)))
    before = gas.transport.inside()
    for n in range(5):
        gas.advance(0.1 * n, 0.1)
    c = grid.read(gas.c)
    assert np.ptp(c, axis=thin).max() <= 1e-6
    assert gas.transport.inside() == pytest.approx(before, rel=1e-6)
