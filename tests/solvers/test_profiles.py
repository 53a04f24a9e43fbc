import numpy as np
import pytest
from scipy.integrate import quad

from taichi_plume.grid.cut_cells import Air
from taichi_plume.grid.grid import Grid
from taichi_plume.scenario.openings import Inlet
from taichi_plume.solvers.openings import JetPatch

DX = 0.05
SHAPES = {2: (8, 20), 3: (8, 12, 20)}  # 1 m high
LOG = {"kind": "log", "roughness": 0.01}
POWER = {"kind": "power", "exponent": 0.25}
TABLE = {"kind": "table", "heights": [0.0, 0.2, 0.5, 1.0], "speeds": [0.0, 3.0, 1.0, 2.0]}
SPEEDS = [
    (LOG, lambda h: max(np.log(h / 0.01), 0.0)),
    (POWER, lambda h: h**0.25),
    (TABLE, lambda h: np.interp(h, TABLE["heights"], TABLE["speeds"])),
]


def patch_of(profile: dict, dim: int, **more) -> JetPatch:
    inlet = {
        "kind": "inlet",
        "face": "x-",
        "speed": 1.0,
        "profile": {"walls": f"{'xyz'[dim - 1]}-"} | profile,
    }
    grid = Grid(SHAPES[dim], DX, depth=0.5)
    return JetPatch(Inlet.model_validate(inlet | more), "inlet", grid, Air.everywhere(grid).area)


def by_height(speed, low: int, high: int) -> np.ndarray:
    """Mean speed of each row of cells over the mean of all."""
    rows = [quad(speed, n * DX, (n + 1) * DX, points=[n * DX + 0.01])[0] for n in range(low, high)]
    return np.array(rows) / np.mean(rows)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("profile", "speed"), SPEEDS)
def test_the_speed_grows_with_the_height_as_reported(dim, profile, speed):
    found = patch_of(profile, dim).profile
    np.testing.assert_allclose(found.reshape(-1, 20)[0], by_height(speed, 0, 20), rtol=0.02)
    assert found.mean() == pytest.approx(1.0)


@pytest.mark.parametrize(("profile", "speed"), SPEEDS)
def test_a_window_has_its_part_of_it_and_the_flow_rate_of_its_size(profile, speed):
    patch = patch_of(profile, 3, center=(0.3, 0.6), size=(0.2, 0.4))
    assert patch.covered.sum() == 4 * 8
    rows = patch.profile[patch.covered].reshape(4, 8)
    np.testing.assert_allclose(rows[2], by_height(speed, 8, 16), rtol=0.02)
    assert patch.profile.sum() * DX**2 == pytest.approx(0.2 * 0.4)


def test_heights_are_over_the_next_of_several_walls():
    profile = patch_of(POWER | {"walls": ["y-", "y+"]}, 2).profile
    np.testing.assert_allclose(profile, profile[::-1])
    np.testing.assert_allclose(profile[:10], by_height(lambda h: h**0.25, 0, 10), rtol=0.02)
    np.testing.assert_allclose(patch_of(POWER | {"walls": "y+"}, 2).profile, patch_of(POWER, 2).profile[::-1])


@pytest.mark.parametrize(("opening", "speed"), [({}, 1.0), ({"center": [0.6], "size": [0.4]}, 0.5)])
def test_friction_sets_how_the_speed_grows(opening, speed):
    """u = u*/0.41 ln h + constant, the constant such that the mean is the speed."""
    rows = patch_of({"kind": "log", "friction": 0.06}, 2, speed=speed, **opening).profile[8:16]
    steps = np.diff([quad(np.log, n * DX, (n + 1) * DX)[0] / DX for n in range(8, 16)])
    np.testing.assert_allclose(np.diff(rows), 0.06 / 0.41 * steps, rtol=0.02)
