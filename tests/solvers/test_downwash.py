"""Rotors push as much momentum into the air as carries the drone, wherever they are on the grid."""

import numpy as np
import pytest
from rooms import LAMINAR, cfd, flow_in

from taichi_plume.engine import ti
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.bodies import GRAVITY, Body
from taichi_plume.scenario.species import AIR_DENSITY
from taichi_plume.solvers.downwash import Downwash
from taichi_plume.validation.flow_cases import advance, periodic, velocities

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

DX, SHAPE = 0.1, (12, 10, 14)
BODY = Body(kind="drone", mass=0.4, rotor_radius=0.12, arm=0.15, radius=0.3)


class Hover:
    """Two drones in a box of still air, all of whose sides are periodic; the second one may be on the floor."""

    def __init__(self, wind, periodic):
        count = 2
        self.place, self.push = ti.vector_field(2, ti.f32, count), ti.vector_field(3, ti.f32, count)
        self.heading, self.altitude = ti.field(ti.f32, count), ti.field(ti.f32, count)
        self.grid = Grid(SHAPE, DX, periodic=periodic)
        self.model = wind

    def begin(self, places, altitudes, headings=(0.0, 0.0), push=((0, 0, 0), (0, 0, 0)), **body):
        def make(open):
            flight = self.place, self.heading, self.altitude, self.push
            return Downwash(BODY.model_copy(update=body), self.grid, *flight, 0, 2, open)

        self.flow = flow_in(self.grid, self.model, resistances=[make])
        (self.downwash,) = self.flow.resistances
        self.place.from_numpy(places)
        self.heading.from_numpy(headings)
        self.altitude.from_numpy(altitudes)
        self.push.from_numpy(push)

    def momentum(self):
        """Of all air [kg m/s]."""
        u = velocities(self.flow)
        return np.array([AIR_DENSITY * DX**3 * v.astype(float).sum() for v in u])


@pytest.fixture(scope="module")
def hover(taichi):
    return Hover(cfd(periodic("xyz"), **LAMINAR), (True, True, True))


@pytest.mark.parametrize(
    ("place", "altitude", "heading", "radius"),
    [
        ((0.6, 0.5), 0.6, 0.0, 0.12),
        ((0.6137, 0.4421), 0.6519, 0.3, 0.12),
        ((0.05, 0.98), 1.27, 1.0, 0.12),  # about the edges of the box
        ((0.55, 0.55), 0.7, 0.7, 0.25),
        ((0.583, 0.517), 0.68, 2.0, 0.01),  # far smaller than a cell
    ],
)
def test_a_hovering_drone_gives_the_air_its_weight(hover, place, altitude, heading, radius):
    hover.begin([place, (0.3, 0.3)], (altitude, 0.0), (heading, 0.0), rotor_radius=radius)
    advance(hover.flow, 0.2)
    weight = 0.4 * GRAVITY * 0.2
    np.testing.assert_allclose(hover.momentum() / weight, [0, 0, -1], atol=1e-4)
    assert velocities(hover.flow)[2].min() < -0.3


def test_what_a_drone_gains_the_air_loses(hover):
    """It accelerates ahead and upward: the air gets m (g - a). One that falls faster than freely does not suck."""
    hover.begin([(0.6, 0.5), (0.3, 0.3)], (0.6, 0.0), push=[(1.0, -0.5, 2.0), (0, 0, 0)])
    advance(hover.flow, 0.1)
    np.testing.assert_allclose(hover.momentum() / (0.4 * 0.1), [-1.0, 0.5, -GRAVITY - 2.0], rtol=1e-4)
    hover.begin([(0.6, 0.5), (0.3, 0.3)], (0.6, 0.0), push=[(0, 0, -20.0), (0, 0, 0)])
    advance(hover.flow, 0.1)
    assert np.abs(hover.momentum()).max() < 1e-6


def test_drones_above_each_other_push_twice_as_much(hover):
    """Their discs share faces, also across the edge of the box; equal runs are equal to the bit."""
    runs = []
    for places in ([(0.6, 0.5), (0.63, 0.52)], [(0.02, 0.5), (1.15, 0.5)]) * 2:
        hover.begin(places, (0.6, 0.64))
        advance(hover.flow, 0.1)
        np.testing.assert_allclose(hover.momentum()[2] / (0.4 * GRAVITY * 0.1), -2.0, rtol=1e-4)
        runs.append(velocities(hover.flow)[2])
    np.testing.assert_array_equal(runs[0], runs[2])
    np.testing.assert_array_equal(runs[1], runs[3])


def test_rotors_rest_on_the_floor_and_before_the_run(hover):
    hover.begin([(0.6, 0.5), (0.3, 0.3)], (0.0, 0.0))
    advance(hover.flow, 0.1)
    assert hover.flow.max_speed == 0.0
    hover.begin([(0.6, 0.5), (0.3, 0.3)], (0.5, 0.0))
    assert hover.downwash.fastest(-1.0) == 0.0
    hover.flow.advance(-1.0, 0.1)
    assert hover.flow.max_speed == 0.0


def test_strong_thrust_is_calm_for_the_steps_it_is_given(taichi):
    """30 kg on the grid of a drone of 0.4 kg, in a closed box: jets of 40 m/s, and still no divergence."""
    hover = Hover(cfd(), (False, False, False))
    hover.begin([(0.6, 0.5), (0.3, 0.3)], (0.7, 0.0), mass=30.0)
    advance(hover.flow, 0.3)
    found = hover.flow.diagnostics()
    assert 10.0 < found["max_speed"] < 100.0
    assert found["max_divergence"] < 1e-3
    assert found["max_courant"] < 1.5 * hover.model.courant
    assert abs(hover.momentum()[2]) < 1e-3 * 30.0 * GRAVITY * 0.3  # what flows in a closed box goes round
