import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import welch

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.openings import Fan, Inlet
from taichi_plume.solvers.boundaries import Boundaries
from taichi_plume.solvers.inflow import Fluctuations
from taichi_plume.solvers.openings import JetPatch

DX = 0.05
FACE = {"kind": "inlet", "face": "x-", "speed": 1.0}
UPPER = FACE | {"face": "x+"}
SIDE = FACE | {"face": "y+"}
DISC = FACE | {"center": [1.0, 0.5], "diameter": 0.8}
PART = FACE | {"center": [1.0, 0.5], "size": [0.8, 0.6]}
SLOT = FACE | {"center": [1.0], "size": [0.15]}
ROOM, SLAB = (8, 40, 20), (8, 100)


def noise_of(opening: dict, shape: tuple[int, ...], length: float, seed: int = 0) -> Fluctuations:
    grid = Grid(shape, DX)
    one = Inlet.model_validate(opening)
    return Fluctuations(JetPatch(one, one.kind, grid, Air.everywhere(grid).area), length, seed, "inflow 0")


def planes_of(noise: Fluctuations, count: int, apart: float) -> np.ndarray:
    """(count, dim, faces along each axis), so many metres of air from one to the next."""
    patch = noise.patch
    planes = np.zeros((count, *(patch.grid.padded[a] for a in patch.along), patch.grid.dim))
    for plane in planes:
        plane[patch.window] = noise.advance(1.0, apart)
    inner = (slice(patch.grid.ghost, -patch.grid.ghost),) * len(patch.along)
    return np.moveaxis(planes[:, *inner], -1, 1)


@pytest.mark.parametrize(
    ("opening", "shape"),
    [(FACE, ROOM), (SIDE, (40, 8, 20)), (DISC, ROOM), (PART, ROOM), (FACE, SLAB), (SLOT, SLAB)],
)
def test_every_component_has_its_intensity_and_nothing_goes_through(opening, shape):
    noise = noise_of(opening, shape, 0.2)
    patch, planes = noise.patch, planes_of(noise, 1500, 0.1)
    total = np.abs(planes[:, patch.axis].reshape(len(planes), -1).sum(axis=1)).max()
    assert total < 1e-7 * patch.covered.sum()
    within = patch.covered.copy()
    for a in range(within.ndim):
        within &= np.roll(patch.covered, 1, axis=a)
    values = planes[..., within]
    spread = np.sqrt((values**2).mean(axis=(0, 2)))
    np.testing.assert_allclose(spread, 1.0, rtol=0.03 if opening is not SLOT else 0.06)
    cross = np.einsum("tcn,tdn->cd", values, values) / values[:, 0].size
    assert np.abs(cross - np.diag(np.diag(cross))).max() < 0.04
    # alike everywhere on a whole face: the waves have no place that they prefer
    if opening is FACE:
        by_place = values[:, patch.axis].std(axis=0)
        assert by_place.std() < 0.1


@pytest.mark.parametrize(
    ("opening", "shape"), [(FACE, ROOM), (UPPER, ROOM), (SIDE, (40, 8, 20)), (FACE, SLAB), (SIDE, (40, 8))]
)
def test_carried_along_it_is_free_of_divergence(opening, shape):
    """What is at a distance from the face now has passed it before."""
    noise = noise_of(opening, shape, 0.3)
    patch, planes = noise.patch, planes_of(noise, 300, DX / 2)
    deep, middle, there = (planes[n : n + 298].swapaxes(0, 1) for n in range(3))
    inward = 1.0 if patch.side == 0 else -1.0
    net = inward * (deep - there)[patch.axis]
    for k, a in enumerate(patch.along):
        net += np.roll(middle[a], -1, axis=k + 1) - middle[a]
    # but for the blending of boxes; were the components strangers, it would be more than 1
    assert np.sqrt((net**2).mean()) < 0.12 * np.sqrt(((deep - there)[patch.axis] ** 2).mean())


@pytest.mark.parametrize(("shape", "length"), [(SLAB, 0.3), (SLAB, 0.6), (ROOM, 0.25)])
def test_its_integral_length_is_the_one_asked_for(shape, length):
    noise = noise_of(FACE, shape, length)
    through = planes_of(noise, 6000 if len(shape) == 2 else 2000, DX).reshape(-1, len(shape), *shape[1:])[
        :, 0
    ]
    far = round(4 * length / DX)
    lagged = [(through[: len(through) - n] * through[n:]).mean() for n in range(far)]
    found = DX * (np.sum(lagged) / lagged[0] - 0.5)
    assert found == pytest.approx(length, rel=0.12)


def test_its_spectrum_falls_with_five_thirds_down_to_six_cells():
    planes = planes_of(noise_of(FACE, (8, 200), 2.5), 8192, DX)
    k, power = welch(planes[:, 0], 2 * np.pi / DX, nperseg=1024, axis=0)
    power = power.mean(axis=1)
    scaling = (k > 3 / 2.5) & (k < 0.4 * 2 * np.pi / (6 * DX))
    assert np.polyfit(np.log(k[scaling]), np.log(power[scaling]), 1)[0] == pytest.approx(-5 / 3, abs=0.2)
    assert power[k > 2 * np.pi / (5 * DX)].sum() < 1e-3 * power.sum()


def test_it_does_not_repeat():
    noise = noise_of(FACE, SLAB, 0.2)
    planes = planes_of(noise, 4000, 2 * noise.waves.spacing)
    box, size = noise.waves.overlap // 2, planes[0].size
    for apart in (box, 2 * box, 4 * box):
        assert abs((planes[:-apart] * planes[apart:]).sum() / size / len(planes)) < 0.05


@pytest.mark.usefixtures("taichi")
@pytest.mark.parametrize("depth", [2, 12])
def test_targets_have_the_turbulence_and_ghost_layers_repeat_them(depth):
    """The edge's, or across a periodic axis, which may be thinner than its ghost layers."""
    grid = Grid((8, 20, depth), DX, periodic=(False, False, True))
    fan = FACE | {"kind": "fan", "center": [0.2, 0.1], "diameter": 0.5, "swirl": 0.4}
    targets = []
    for intensity in (0.0, 0.1):
        opening = Fan.model_validate(fan | {"turbulence_intensity": intensity, "turbulence_length": 0.1})
        boundaries = Boundaries((opening,), grid, Air.everywhere(grid).area)
        for n in range(3):
            boundaries.update(0.05 * n, 0.05)
        padded, g = boundaries.target[0].to_numpy()[0], grid.ghost
        inner = padded[g:-g, g:-g]
        repeated = np.pad(inner, [(g, g), (0, 0), (0, 0)], mode="edge")
        np.testing.assert_array_equal(np.pad(repeated, [(0, 0), (g, g), (0, 0)], mode="wrap"), padded)
        targets.append(inner)
    noise = Fluctuations(boundaries.jets[0], 0.1, 0, "inflow 0")
    plane = np.moveaxis(planes_of(noise, 3, 0.05)[-1], 0, -1)
    np.testing.assert_allclose(targets[1] - targets[0], 0.1 * plane, atol=1e-6)
    assert plane.any()


def test_air_that_stands_still_brings_nothing_new_and_what_passed_decides():
    noise, same = noise_of(FACE, SLAB, 0.2), noise_of(FACE, SLAB, 0.2)
    before = noise.advance(1.0, 3.0)
    np.testing.assert_array_equal(noise.advance(0.0, 5.0), before)
    planes_of(same, 50, 0.1)
    same.travelled = noise.travelled
    np.testing.assert_array_equal(same.advance(-0.5, 0.2), noise.advance(0.5, 0.2))
    assert np.abs(noise_of(FACE, SLAB, 0.2, seed=1).advance(1.0, 3.0) - before).max() > 0.1


@pytest.mark.parametrize("length", [1e-6, 0.02, 50.0])
def test_any_length_is_possible(length):
    planes = planes_of(noise_of(FACE, SLAB, length), 3, 0.1)
    assert np.isfinite(planes).all()
    assert planes.std() > 0.1


def test_a_small_opening_has_the_energy_of_the_waves_that_it_carries():
    """Of a von Karman spectrum of the nominal length, by quadrature."""
    fan = FACE | {"center": [1.0, 0.5], "diameter": 0.3}
    small, wide = (noise_of(one, ROOM, 0.06) for one in (fan, fan | {"diameter": 0.6}))
    peak, cut = 0.7468 / 0.06, 2 * np.pi / (6 * DX)
    energy, whole = (
        quad(lambda k: k**4 / (peak**2 + k**2) ** (17 / 6), 0.0, end)[0] for end in (cut, np.inf)
    )
    assert small.waves.strength == pytest.approx(np.sqrt(energy / whole), rel=1e-4)
    assert wide.waves.strength == 1.0
    planes = planes_of(small, 1500, 0.1)[:, 0][:, small.patch.covered]
    assert planes.std() == pytest.approx(np.sqrt(energy / whole), rel=0.06)


def test_one_cell_has_only_motion_along_the_face():
    u, v = planes_of(noise_of(FACE | {"center": [1.02], "size": [0.04]}, SLAB, 0.2), 200, 0.1).swapaxes(0, 1)
    assert not u.any()
    assert not v.any()
