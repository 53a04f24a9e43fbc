"""What may be asked for of a result is what results hold."""

from math import inf
from typing import Any

import fake_run
import pytest

from taichi_plume.execution import result
from taichi_plume.files.json_values import json_value
from taichi_plume.scenario.belief_algorithms import Infotaxis
from taichi_plume.scenario.motion import Motion
from taichi_plume.scenario.obstacles import Cylinder
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.scoring.maps import MapScores
from taichi_plume.studies.outcomes import OutcomeCheck, limits_of

pytestmark = pytest.mark.usefixtures("taichi")
OF_THE_MACHINE = {"wall_s", "Mcell_steps_per_s"}
WORDS = {"unlike_them", "air_by_chance", "trials_differ_by", "no_search"}
FREE = {"flow", "gas", "forecast", "mean_gas"}  # solvers and maps tell what they want there


def numbers(content: Any, path: str = "") -> dict[str, Any]:
    """All numbers of a result by their paths."""
    if isinstance(content, dict | list):
        pairs = content.items() if isinstance(content, dict) else enumerate(content)
        return {key: value for name, part in pairs for key, value in numbers(part, f"{path}.{name}").items()}
    text = isinstance(content, str)
    return {} if text else {path.lstrip("."): content}


@pytest.fixture(scope="module")
def run() -> tuple[Scenario, set[str]]:
    """A scenario, and the paths of all numbers in its result that runs decide."""
    sim = fake_run.simulation(fake_run.scenario(2, duration=9, warm_up=1))
    scores = MapScores(sim)
    sim.observers.append(scores.observer())
    sim.run()
    content = json_value(result.result(sim, "completed", "", "cpu", scores))
    found = {path for path in numbers(content) if path.rpartition(".")[2] not in WORDS}
    assert len(found) > 100
    return sim.scenario, found - OF_THE_MACHINE


def refused(scenario: Scenario, paths: set[str]) -> set[str]:
    wanted = OutcomeCheck({path: path for path in paths}, ())
    wanted.look(scenario)
    assert len(wanted.lines) == len(wanted.outcomes)
    return set(wanted.outcomes)


def test_every_number_of_a_result_may_be_asked_for(run):
    assert refused(*run) == set()


def test_what_no_result_has_may_not(run):
    scenario, found = run
    sections = {path.rpartition(".")[0] for path in found} - {""}
    known = {path for path in sections if not FREE & set(path.split("."))}
    known = {path for path in known if not (path.startswith("maps.") and "per_trial" in path)}
    assert {"groups.0", "groups.0.summary.time_s", "maps.0", "groups.0.per_trial.found"} <= known
    absent = known | {f"{path}.nothing" for path in known} | OF_THE_MACHINE | {"name", "nothing"}
    assert refused(scenario, absent) == absent


def test_beliefs_leave_maps(run):
    scenario, _ = run
    algorithm = Infotaxis.model_validate({"kind": "infotaxis"})
    believing = [group.model_copy(update={"algorithm": algorithm}) for group in scenario.robots]
    for robots, absent in ((scenario.robots, ["maps.zarr"]), (believing, [])):
        one = scenario.model_copy(update={"maps": (), "robots": tuple(robots)})
        wanted = OutcomeCheck({"p": "beliefs.0.within_reach", "no": "beliefs.9.within_reach"}, ["maps.zarr"])
        wanted.look(one)
        assert wanted.keep == absent
        assert list(wanted.outcomes) == (["p", "no"] if absent else ["no"])


def test_pushes_may_be_asked_for_where_an_obstacle_moves():
    paths = {"groups.0.per_trial.pushes.0", "groups.0.per_trial.pinned_s.1"}
    still = Cylinder(kind="cylinder", center=(1.0, 1.0), radius=0.2)
    walker = still.model_copy(update={"motion": Motion(path=((1.0, 1.2, 1.0),))})
    for obstacles, left in (([], paths), ([still], paths), ([still, walker], set())):
        scenario = fake_run.scenario(2).model_copy(update={"obstacles": obstacles})
        assert refused(scenario, paths) == left


@pytest.mark.parametrize(
    ("path", "limits"),
    [
        ("maps.0.correlation", (-1.0, 1.0)),
        ("maps.0.mean_gas.correlation.3", (-1.0, 1.0)),
        ("maps.0.known_fraction", (0.0, 1.0)),
        ("groups[0].summary.declared_rate.low", (0.0, 1.0)),
        ("groups.0.per_trial.success.2", (0.0, 1.0)),
        ("maps.0.mae_ppm", (0.0, inf)),
        ("groups.0.median_time_s", (0.0, inf)),
        ("groups.0.beside_recorded.bias_ppm", (-inf, inf)),
        ("gas.relative_error", (-inf, inf)),
        ("flow.lift", (-inf, inf)),
        ("probes.success.wind_x", (-inf, inf)),
        ("probes.door.ethanol_ppm", (0.0, inf)),
    ],
)
def test_numbers_have_a_range(path, limits):
    assert limits_of(path) == limits
