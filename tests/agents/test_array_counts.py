"""Number of arrays that a kernel of robots takes on a device, counted while kernels are traced; none is compiled."""

import pytest
from robots import room, team

from taichi_plume.agents.algorithm_table import ALGORITHMS
from taichi_plume.assembly.assemble import assemble
from taichi_plume.engine import fields, kernels, uploads
from taichi_plume.scenario.loading import scenario_from

pytestmark = pytest.mark.usefixtures("taichi")

MOST = 22
"""Arrays of a kernel. Metal gives 31, Mesa's lavapipe 32; two more hold numbers."""
HEARS = [kind for kind in ALGORITHMS if "infotaxis" in kind or kind.startswith(("surge", "casting"))]
HEARS += ["particle_filter", "hit_map"]


@pytest.fixture
def counts(monkeypatch):
    """Numbers of arrays of the kernels that are traced in a test, by name. Nothing is launched."""
    counted, bind = {}, kernels.Bound.__init__

    def note(bound, kernel, instance, values):
        bind(bound, kernel, instance, values)
        arrays = sum(kind == "field" for _, kind in bound.extra) + len(instance.arrays)
        counted[instance.name] = arrays

    monkeypatch.setattr(fields, "memory_is_shared", lambda: True)
    monkeypatch.setattr(kernels, "compile_kernel", lambda program, traced: None)
    monkeypatch.setattr(kernels, "_instances", {})
    monkeypatch.setattr(kernels.Bound, "__init__", note)
    monkeypatch.setattr(kernels.Bound, "__call__", lambda bound, *arguments: 0 if bound.returns else None)
    monkeypatch.setattr(uploads, "load", lambda line, values: values.fill(1))
    return counted


@pytest.mark.parametrize("kind", [kind for kind in ALGORITHMS if kind != "external"])
def test_kernels_of_robots_take_few_arrays_on_a_device(kind, counts):
    algorithm = {"kind": kind} | ({"threshold_ppm": 5.0} if kind in HEARS else {})
    flies = kind == "casting_3d"
    keys = {"body": {"kind": "drone"}} if flies else {"localization": {"kind": "camera"}}
    at = [0.5, 1.5, 1.0][: 2 + flies]
    air = {"kind": "gaussian_plume", "intensity": 0.1, "sources": [{"position": at, "rate": "1 mg/s"}]}
    case = room(team((1, 1), (2, 1), algorithm=algorithm, **keys), gas=air)
    if flies:
        case |= {"domain": {"size": [4.0, 3.0, 2.0], "spacing": 0.2}}
        case |= {"wind": {"kind": "uniform", "velocity": [0.5, 0.0, 0.0]}}
    sim = assemble(scenario_from(case))
    for _ in range(2):
        sim.advance()
    assert len(counts) >= 4
    assert max(counts.values()) <= MOST, counts
