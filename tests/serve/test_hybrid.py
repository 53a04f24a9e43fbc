"""A robot outside finds the leak of the PlumeSim arena as one inside does."""

import pytest

pytest.importorskip("zenoh")

from taichi_plume.validation.hybrid_cases import searched
from taichi_plume.validation.plumesim_cases import LAMINAR, PLUME, arena, in_airs
from taichi_plume.validation.searches import WAY

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("taichi")]
TRIALS = 30


@pytest.mark.parametrize("takes", ["pose", "velocity"])
def test_robots_outside_search_as_those_inside(takes, inside):
    found = searched(TRIALS, takes)
    assert found["success"].mean == inside["success"].mean == 1.0
    for quantity in ("time [s]", WAY):  # their turns and lanes are alike; each draws its own noise
        assert found[quantity].mean == pytest.approx(inside[quantity].mean, rel=0.05)


@pytest.fixture(scope="module")
def inside(taichi):
    return in_airs(TRIALS, arena(LAMINAR, PLUME), "inside")
