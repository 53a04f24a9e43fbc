import numpy as np
import pytest
from rooms import LAMINAR, cfd

from taichi_plume.grid.cut_cells import air_of
from taichi_plume.grid.grid import Grid
from taichi_plume.grid.shapes import Ball
from taichi_plume.scenario.obstacles import Sphere
from taichi_plume.scenario.species import AIR_DENSITY
from taichi_plume.solvers.flow import FlowSolver
from taichi_plume.solvers.forces import Forces
from taichi_plume.validation.flow_cases import advance, periodic

pytestmark = pytest.mark.usefixtures("taichi")


@pytest.mark.slow
def test_bodies_take_what_drives_the_air():
    """In a periodic box: from rest, all that the air lacks; once it is steady, the driving force on all the air."""
    grid = Grid((40, 40), 0.025, depth=0.2, periodic=(True, True))
    places = ((0.3, 0.52, 0.15), (0.71, 0.33, 0.08))
    bodies = [Ball(Sphere(kind="sphere", center=(x, y), radius=r), 2) for x, y, r in places]
    push = (1.0, 0.4)
    air = air_of(bodies, grid)
    flow = FlowSolver(cfd(periodic("xy"), viscosity=0.1, acceleration=push, **LAMINAR), grid, air)
    forces = Forces(flow, air, 2)
    begin, impulse = 0.3, np.zeros(2)
    t = 0.0
    while begin - t > 1e-9:
        dt = min(flow.stable_dt(), begin - t)
        flow.advance(t, dt)
        impulse += forces().sum(axis=0) * dt
        t += dt
    share = [0.5 * (air.volume + np.roll(air.volume, 1, axis=d)) for d in range(2)]
    moved = [(grid.read(flow.u[d]) * share[d]).sum() for d in range(2)]
    driven = air.volume.sum() * np.array(push) * begin
    left = (driven - moved) * AIR_DENSITY * grid.cell_volume
    np.testing.assert_allclose(impulse, left, rtol=0.01)  # step by step, from rest
    advance(flow, 3.0, begin)
    taken = forces()
    mass = AIR_DENSITY * air.volume.sum() * grid.cell_volume
    assert taken.sum(axis=0) == pytest.approx(mass * np.array(push), rel=0.02)
    assert (taken[0] > taken[1]).all()  # the larger body takes more
    assert (taken > 0).all()
