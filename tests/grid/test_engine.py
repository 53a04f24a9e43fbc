"""Lifetime of fields: what is used after Taichi was started again, and what `start` keeps."""

import pytest
import taichi as ti
import yaml
from taichi.lang import impl

from taichi_plume.assembly.assemble import assemble
from taichi_plume.grid import engine, kernels
from taichi_plume.grid.transfer import uploader
from taichi_plume.scenario.loading import scenario_from

pytestmark = pytest.mark.slow

ROOM = yaml.safe_load("""
duration: 1
domain: {size: [1, 0.8], spacing: 0.1}
wind: {kind: uniform, velocity: [0.5, 0]}
gas: {kind: eulerian, sources: [{position: [0.2, 0.4], rate: 1.0e-6}]}
robots: [{count: 1, start: {kind: positions, positions: [[0.8, 0.4]]}, algorithm: {kind: casting}, reach: 0.1}]
""")


@pytest.mark.parametrize(
    "restart", [lambda: kernels.start("cpu", threads=1), lambda: ti.init(ti.cpu), ti.reset], ids=range(3)
)
def test_a_simulation_whose_engine_is_gone_refuses_every_use(taichi, restart):
    sim = assemble(scenario_from(ROOM))
    sim.advance()
    restart()
    gas = sim.gas.gases[0]
    uses = (
        sim.advance,
        sim.run,
        sim.reset,
        sim.swarm.snapshot,
        gas.budget,
        gas.is_finite,
        lambda: gas.c[0, 0],
    )
    for use in uses:
        with pytest.raises(engine.EngineError, match="assemble"):
            use()
    kernels.start()


def test_fields_of_a_program_that_ended_raise_and_later_ones_work(taichi):
    old, vectors = ti.field(ti.f32, 3), ti.Vector.field(2, ti.f32, 3)
    old.fill(1.0)
    vectors.fill(1.0)
    ti.reset()
    kernels.start()
    new = ti.field(ti.f32, 3)
    new.fill(2.0)
    uses = (
        lambda: old[0],
        lambda: old.to_numpy(),
        lambda: vectors.shape,
        lambda: old.fill(0),
        lambda: old.dtype,
    )
    for use in uses:
        with pytest.raises(engine.EngineError):
            use()
    assert new.to_numpy().tolist() == [2.0, 2.0, 2.0]


@pytest.mark.parametrize("in_use", [True, False])
def test_a_start_with_the_same_arguments_keeps_what_is_in_use_and_else_frees_the_memory(taichi, in_use):
    ti.reset()
    kernels.start("cpu", threads=1)
    field = ti.field(ti.i32, 2)
    field.fill(3)  # a kernel of a module, which keeps its arguments
    program = impl.get_runtime().prog
    if not in_use:
        del field
    assert kernels.start("cpu", threads=1) == "cpu"
    assert (impl.get_runtime().prog is program) == in_use
    if in_use:
        assert field[1] == 3
        kernels.start("cpu", threads=2)
        assert impl.get_runtime().prog is not program


def test_kernels_that_nothing_uses_are_forgotten(taichi):
    def make():
        field = ti.field(ti.i32, 2)

        @ti.kernel
        def put():
            for i in field:
                field[i] = i

        put()
        return put

    put = make()
    before = len(impl.get_runtime().kernels)
    assert engine.live_fields()
    del put
    assert not kernels._fields_in_use()
    assert len(impl.get_runtime().kernels) < before


@pytest.mark.cpu
def test_trees_of_fields_that_are_gone_make_room_and_the_others_keep_their_values(taichi):
    ti.reset()
    kernels.start("cpu", threads=1)
    kept = ti.field(ti.i32, 3)
    kept.fill(7)
    put = uploader(kept)
    sizes = []
    for n in range(5):
        passing = ti.field(ti.i32, 3 + n)
        passing.fill(n)
        put_passing = uploader(passing)
        put_passing(n)
        assert passing[2] == n
        sizes.append(impl.get_runtime().prog.get_snode_tree_size())
        del passing, put_passing
        kernels.ensure_started()
        assert kept.to_numpy().tolist() == [7 + n] * 3
        put(8 + n)
    assert max(sizes) == sizes[0]
