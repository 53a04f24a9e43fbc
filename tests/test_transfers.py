"""Transfers between host and device, with fields and kernels in the form for a GPU, which here run on the CPU."""

import sys
from collections.abc import Callable

import numpy as np
import pytest
from taichi.lang._ndarray import ScalarNdarray
from taichi.lang.matrix import VectorNdarray

from taichi_plume import Simulation
from taichi_plume.engine import device_loops, kernels, ti
from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.openings import Inlet
from taichi_plume.solvers.boundaries import Boundaries

pytestmark = pytest.mark.usefixtures("taichi")


@pytest.fixture
def device(monkeypatch):
    """Return a list that gets the name of each transfer of a field from now on."""
    for name, module in list(sys.modules.items()):
        if name.startswith("taichi_plume") and hasattr(module, "on_cpu"):
            monkeypatch.setattr(module, "on_cpu", lambda: False)
    monkeypatch.setattr(device_loops, "block_size", lambda: 1)
    monkeypatch.setattr(kernels, "_instances", {})
    moved = []

    def counted(move: Callable) -> Callable:
        def call(*arguments):
            moved.append(move.__name__)
            return move(*arguments)

        return call

    for kind in (ScalarNdarray, VectorNdarray):
        for name in ("to_numpy", "from_numpy"):
            monkeypatch.setattr(kind, name, counted(getattr(kind, name)))
    return moved


@pytest.mark.parametrize("dtype", [ti.f32, ti.f64, ti.i32, ti.u32])
@pytest.mark.parametrize(("n", "shape", "order"), [(0, (), None), (3, (5,), None), (2, (3, 4), "ji")])
def test_few_numbers_reach_a_device_without_a_transfer(device, dtype, n, shape, order):
    field = ti.vector_field(n, dtype, shape, order) if n else ti.field(dtype, shape, order)
    values = np.array(np.random.default_rng(1).uniform(0.0, 4e9, field.values.shape))
    if dtype == ti.i32:
        values -= 2e9
    device.clear()
    field[None] = values
    assert device == []
    np.testing.assert_array_equal(field.values, values.astype(field.values.dtype))


def jets() -> Boundaries:
    turbulent = {"kind": "inlet", "face": "x-", "speed": 1.0, "turbulence_intensity": 0.2}
    ramped = {"kind": "inlet", "face": "y+", "speed": 0.5, "center": [0.8], "size": [0.4], "ramp": 3.0}
    grid = Grid((30, 20), 0.05)
    return Boundaries(
        tuple(Inlet.model_validate(one) for one in (turbulent, ramped)), grid, Air.everywhere(grid).area
    )


def targets_at(times: np.ndarray, boundaries: Boundaries) -> np.ndarray:
    result = []
    for t in times:
        boundaries.update(t, times[0])
        result.append(np.concatenate([target.values.ravel() for target in boundaries.target]))
    return np.array(result)


def test_jets_blow_alike_on_a_device_and_send_it_only_blocks_of_turbulence(request):
    times = 0.07 * np.arange(1, 61)  # past the first box of waves
    expected = targets_at(times, jets())
    moved = request.getfixturevalue("device")
    there = jets()
    moved.clear()
    np.testing.assert_allclose(targets_at(times, there), expected, atol=1e-6)
    assert 0 < moved.count("from_numpy") < len(times) / 5


def test_a_tick_of_a_closed_form_plume_and_of_a_robot_needs_no_transfer(device):
    scenario = {
        "name": "plume",
        "duration": 10,
        "stop_early": False,
        "domain": {"size": [4.0, 3.0], "spacing": 0.1, "depth": 0.5},
        "wind": {"kind": "uniform", "velocity": [0.4, 0.0]},
        "gas": {
            "kind": "gaussian_plume",
            "intensity": 0.15,
            "sources": [{"position": [0.6, 1.5], "rate": 1e-5}],
        },
        "robots": [
            {
                "count": 2,
                "start": {"kind": "line", "begin": [3, 1], "end": [3, 2]},
                "algorithm": {"kind": "casting"},
            }
        ],
    }
    simulation = Simulation(scenario)
    simulation.step()
    device.clear()
    simulation.step(5)
    assert device == []
