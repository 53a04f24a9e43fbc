"""No kernel reads or writes beyond its fields: Taichi looks at every index, which it does not in a run.

``TI_DEBUG=1 pytest`` has every test look; it takes three times as long.
"""

from pathlib import Path

import pytest

from taichi_plume import kernels, load_scenario
from taichi_plume.assemble import assemble
from taichi_plume.validation.cross_checks import one_layer

CONFIGS = Path(__file__).parents[1] / "configs"
STORIES = ("moving_obstacle", "puffs_arena", "odor_mapping_dapso")

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def checked(taichi):
    kernels.start("cpu", debug=True)


@pytest.mark.parametrize("name", STORIES)
def test_a_story_stays_within_its_fields(name):
    path = CONFIGS / f"{name}.yaml"
    scenario = load_scenario(path, ["warm_up=0.4", "duration=6" if "mapping" in name else "duration=0.4"])
    assemble(scenario, path.parent).run()


def test_a_flow_in_one_layer_of_cells_stays_within_its_fields():
    assert one_layer(16)
