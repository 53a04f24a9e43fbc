"""No kernel reads or writes beyond its fields: Taichi looks at every index, which it does not in a run.

``TI_DEBUG=1 pytest`` has every test look; it takes three times as long.
"""

from pathlib import Path

import pytest

from taichi_plume import load_scenario
from taichi_plume.assembly.assemble import assemble
from taichi_plume.engine import program
from taichi_plume.validation.cross_checks import one_layer

CONFIGS = Path(__file__).parents[1] / "configs"
pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def checked():
    program.start("cpu", debug=True)


def test_robots_and_maps_stay_within_their_fields():
    path = CONFIGS / "odor_mapping_dapso.yaml"
    scenario = load_scenario(path, ["warm_up=0.4", "duration=6"])
    assemble(scenario, path.parent).run()


def test_a_flow_in_one_layer_of_cells_stays_within_its_fields():
    one_layer(16)
