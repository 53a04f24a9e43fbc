"""What particles tell of the mixing of a room, beside closed forms and the flow on the grid."""

import numpy as np
import pytest
from rooms import assert_same, blocks, march

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.fields import velocity_at
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.winds import SyntheticWind
from taichi_plume.solvers import room_mixing
from taichi_plume.solvers.synthetic_flow import SyntheticSolver

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

SHAPES = [(60, 42), (30, 21, 12)]


@pytest.fixture(scope="module", params=SHAPES)
def air(request, taichi):
    """A room of 3 m x 2.1 m (x 1.2 m) with a box, at its begin."""
    shape = request.param
    grid = Grid(shape, 3.0 / shape[0])
    solid = blocks(shape, tuple(slice(n // 3, n // 2) for n in shape))
    wind = SyntheticSolver(SyntheticWind(kind="synthetic", shortest=0.5), grid, Air.of(solid, grid))
    return grid, solid, wind


@pytest.mark.parametrize("K", [0.002, 0.3])
def test_walkers_in_a_box_diffuse_as_they_do(K):
    """Brownian motion between mirrors, for a short time and until it has forgotten where it began."""
    extent, rng = np.array([5.0, 4.0, 2.5]), np.random.default_rng(1)
    x, places = rng.random((8, 400, 3)) * extent, []
    for _ in range(151):
        places.append(x)
        x = x + np.sqrt(2.0 * K) * rng.standard_normal(x.shape)
        x = extent - np.abs(extent - np.abs(x))
    found, error = room_mixing.rates(np.array(places), 1.0, extent, (np.zeros(3), (np.pi / extent) ** 2))
    assert error < 0.1 * K
    assert abs(found - K) < 3.5 * error


@pytest.mark.parametrize("part", [0.2, 0.5, 1.0])
def test_what_obstacles_leave_of_a_room_mixes_by_itself(taichi, part):
    """Where a block fills one end of a room, the slowest mode is of the length that is left."""
    grid = Grid((60, 6), 0.1)
    solid = blocks(grid.shape, np.s_[round(60 * part) :])
    wind = SyntheticSolver(SyntheticWind(kind="synthetic"), grid, Air.of(solid, grid))
    mean, quotient = wind.room.even()
    length = 6.0 * part  # by integrals over it
    k = np.pi / 6.0
    first, second = np.sin(k * length) / (k * length), 0.5 + np.sin(2.0 * k * length) / (4.0 * k * length)
    assert mean[0] == pytest.approx(first, abs=2e-3)
    assert quotient[0] == pytest.approx(k**2 * (1.0 - second) / (second - first**2), rel=0.02)
    assert 1.0 <= quotient[0] / (np.pi / length) ** 2 < 1.6
    assert quotient[1] == pytest.approx((np.pi / 0.6) ** 2)


def test_a_channel_too_narrow_for_eddies_is_at_rest(taichi):
    """All of its faces are walls, or lie along them."""
    grid = Grid((20, 8), 0.1)
    solid = np.ones(grid.shape, bool)
    solid[:, 3] = False
    wind = SyntheticSolver(SyntheticWind(kind="synthetic"), grid, Air.of(solid, grid))
    assert all(not grid.read(u).any() for u in wind.u)
    assert wind.max_viscosity == pytest.approx(wind.viscosity)
    assert wind.mixing()["eddy_diffusivity_m2_per_s"] == 0.0


def test_air_that_rests_mixes_nothing(taichi):
    grid = Grid((12, 8), 0.25)
    wind = SyntheticSolver(
        SyntheticWind(kind="synthetic", speed=0, circulation=0), grid, Air.everywhere(grid)
    )
    assert wind.mixing() == {"eddy_diffusivity_m2_per_s": 0.0, "eddy_diffusivity_error_m2_per_s": 0.0}


def test_the_particles_ride_the_flow_of_the_run(air):
    grid, solid, _ = air
    model = SyntheticWind(kind="synthetic", shortest=0.5, longest=1.4)
    wind = SyntheticSolver(model, grid, Air.of(solid, grid), 0.0, 4)
    march(3, wind.interval, wind)
    room, t = wind.room, 3 * wind.interval
    x = room.starts(2000, np.random.default_rng(0))
    x = x[room.around(x)[0] > grid.dx]
    u = velocity_at(wind, x, 0.0)
    turn = {m: np.full(len(x), value) for m, value in wind._turn.items()}
    ridden = room.velocity(x, np.tile(wind._waves.frequency * t, (len(x), 1)), turn)
    assert np.sqrt(((ridden - u) ** 2).mean()) < 1.5 * grid.dx * np.sqrt((u**2).mean())
    np.testing.assert_allclose(
        room.spreading(x)[0] * room.schmidt,
        np.maximum(room.eddies * room.around(x)[1] - room.viscosity, 0.0),
    )


def test_they_stay_in_the_air_and_fill_it_evenly(air):
    grid, solid, wind = air
    room = wind.room
    places = room_mixing.particle_paths(room, np.random.default_rng(2), 1.0, 60)[-20:].reshape(-1, grid.dim)
    cells = tuple((places / grid.dx).astype(int).T)
    assert not solid[cells].any()
    halves = places < 0.5 * np.array(grid.extent)
    middles = (np.argwhere(~solid) + 0.5) * grid.dx < 0.5 * np.array(grid.extent)
    np.testing.assert_allclose(halves.mean(axis=0), middles.mean(axis=0), atol=0.08)


def test_mirrors_face_each_other(air):
    """However far a particle is thrown, it is in the room, as far from the mirror as it came beyond it."""
    grid, _, wind = air
    L = np.array(grid.extent)
    far = np.stack([-0.1 * L, 1.1 * L, 2.1 * L, 9.9 * L, -7.9 * L])
    near = np.stack([0.1 * L, 0.9 * L, 0.1 * L, 0.1 * L, 0.1 * L])
    np.testing.assert_allclose(wind.room.inside(far, np.full_like(far, -1.0)), near)


def test_measuring_changes_nothing(air):
    grid, solid, _ = air
    model = SyntheticWind(kind="synthetic", shortest=0.5)

    def frames(measure):
        wind = SyntheticSolver(model, grid, Air.of(solid, grid), 0.0, 7)
        seen = []
        for n in range(3):
            wind.advance(4.0 * n, 4.0)
            seen += [grid.read(u) for u in wind.u]
            reported = wind.mixing() if measure else {}
        return seen, reported, wind

    plain, *_ = frames(False)
    measured, reported, wind = frames(True)
    assert_same(plain, measured)
    assert reported == wind.mixing()
    assert reported["eddy_diffusivity_m2_per_s"] > 0.0
    assert ("as_of_air_changes_per_h" in reported) == (grid.dim == 3)


def test_measured_rooms():
    """5 m x 4 m x 2.5 m: L² = 13.57 m², of which 0.31 an hour without air changes and 0.83 with one."""
    assert room_mixing.diffusivity(50.0, 0.0) == pytest.approx(1.169e-3, rel=1e-3)
    assert room_mixing.diffusivity(50.0, 1.0) == pytest.approx(3.129e-3, rel=1e-3)
    assert room_mixing.air_changes(3.129e-3, 50.0) == pytest.approx(1.0, rel=1e-3)
