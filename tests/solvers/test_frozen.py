from collections.abc import Callable

import numpy as np
import pytest
from rooms import TUNNEL, assert_same, blocks, eulerian, largest_outflow, march, missing

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.state import State
from taichi_plume.scenario.winds import FrozenWind
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.frozen_flow import FrozenSolver
from taichi_plume.solvers.gas import EulerianSolver

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

SHAPE = (24, 16)
GRID = Grid(SHAPE, 0.05)
KEYS = {"openings": [TUNNEL[0] | {"turbulence_intensity": 0.2}, TUNNEL[1]]}
AFTER, AVERAGE, BEGIN = 1.2, 0.5, -2.0
SOLID = blocks(SHAPE, np.s_[8:11, 5:8])


@pytest.fixture(scope="module")
def frozen(taichi) -> Callable[..., FrozenSolver]:
    """A flow that is at its begin, and will freeze."""
    wind = {"kind": "frozen", "after": AFTER, "average": AVERAGE} | KEYS

    def made(**changes) -> FrozenSolver:
        return FrozenSolver(FrozenWind.model_validate(wind | changes), GRID, Air.of(SOLID, GRID), BEGIN, 4)

    return made


STEPS = np.array([0.01, 0.02, 0.0125] * 40)  # uneven, so that the weights count
ENDS = BEGIN + np.cumsum(STEPS)


def fields_of(flow: FlowSolver) -> list[np.ndarray]:
    return [field.to_numpy().astype(float) for field in (*flow.u, flow.nu)]


def test_flow_becomes_its_mean(frozen, monkeypatch):
    states = []  # after each step, as the flow solver leaves it
    step = FlowSolver.advance

    def watched(flow: FlowSolver, t: float, dt: float) -> None:
        step(flow, t, dt)
        states.append(fields_of(flow))

    monkeypatch.setattr(FlowSolver, "advance", watched)
    held = frozen()
    for end, dt in zip(ENDS, STEPS, strict=True):
        held.advance(end - dt, dt)
    last = int(np.argmax(ENDS >= BEGIN + AFTER - 1e-9))
    assert len(states) == last + 1 < len(ENDS), "no step after it froze"
    span = np.flatnonzero(ENDS - STEPS >= BEGIN + AFTER - AVERAGE - 1e-9)
    span = span[span <= last]
    for k, mean in enumerate(fields_of(held)):
        wanted = np.average([states[n][k] for n in span], axis=0, weights=STEPS[span])
        np.testing.assert_allclose(mean, wanted, atol=2e-6)
    spread = np.std([states[n][1] for n in span], axis=0).max()
    assert spread > 0.02, "there was something to average"
    assert held.diagnostics()["max_divergence"] < 1e-4


def test_frozen_air_has_no_limit_and_carries_gas(frozen):
    held = frozen(after=0.2, average=None)
    assert np.isfinite(held.stable_dt(BEGIN))
    for n in range(20):
        held.advance(BEGIN + 0.01 * n, 0.01)
    assert held.stable_dt(0.0) == float("inf")
    assert held.outflow_rate == pytest.approx(largest_outflow(held), rel=1e-5)
    assert held.max_viscosity == pytest.approx(GRID.read(held.nu).max(), rel=1e-5)
    gas = EulerianSolver(eulerian((0.2, 0.4), 1e-5), held.grid, held, Air.of(SOLID, GRID))
    march(60, 0.1, gas)
    assert abs(missing(gas)) < 1e-5
    assert gas.least() >= 0


def test_a_saved_mean_goes_on_to_the_bit(frozen):
    """Saved while it is averaged, and after it froze."""
    held = frozen(after=0.2, average=0.1)
    state, saved = State(held), []
    for n in range(25):
        saved.append(state.save())
        held.advance(BEGIN + 0.01 * n, 0.01)
    found = [*fields_of(held), np.array([held.stable_dt(), held.outflow_rate])]
    assert held.frozen
    for begin in (14, 22):
        state.restore(saved[begin])
        for n in range(begin, 25):
            held.advance(BEGIN + 0.01 * n, 0.01)
        assert_same([*fields_of(held), np.array([held.stable_dt(), held.outflow_rate])], found)
