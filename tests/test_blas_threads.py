"""Equal bits with any number of BLAS threads, through the entries of every run: `build` and the time loop."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from threadpoolctl import ThreadpoolController, threadpool_limits

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import load_scenario
from taichi_plume.engine.choice import chosen
from taichi_plume.execution.result import machine
from taichi_plume.grid.state import State
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.time_loop import Every
from taichi_plume.validation.same_runs import shortened

pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.cpu]

CONFIGS = Path(__file__).parent.parent / "configs"
QUICK = ("spiral_room", "playback")  # a sum of waves by a product of matrices; a run without such products
NAMES = sorted(path.stem for path in CONFIGS.glob("*.yaml"))


def short(name: str, seconds: float) -> Scenario:
    path = CONFIGS / f"{name}.yaml"
    keys = shortened(yaml.safe_load(path.read_text()), seconds)
    return load_scenario(
        path, [f"{key}={value if value is not None else 'null'}" for key, value in keys.items()]
    )


def end_of_run(scenario: Scenario, threads: int) -> dict:
    """State of a new simulation after its run, in a process whose BLAS uses `threads` threads."""
    with threadpool_limits(threads, user_api="blas"):
        sim = assemble(scenario, CONFIGS)
        sim.run()
        return State(sim).save()


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else pytest.mark.slow) for name in NAMES]
)
def test_the_bits_do_not_depend_on_the_threads_of_blas(name):
    scenario = short(name, 0.3)
    one, two = (end_of_run(scenario, threads) for threads in (1, 2))
    assert one.keys() == two.keys()
    for path, value in one.items():
        np.testing.assert_equal(two[path], value, err_msg=path)


def test_blas_uses_one_thread_during_a_run_only():
    """Further threads would spin on the cores that kernels need; the caller's products keep their threads."""
    blas, seen = ThreadpoolController().select(user_api="blas"), []

    def threads(_=None) -> None:
        seen.append({library["num_threads"] for library in blas.info()})

    with blas.limit(limits=2):
        sim = assemble(short("gaussian", 0.3), CONFIGS)
        sim.observers.append(Every(sim.dt, threads))
        sim.step()
        sim.run()
        assert len(seen) > 1
        assert all(found == {1} for found in seen)
        threads()
        assert seen[-1] == {2}


def test_a_result_names_the_processor_and_the_kernels_of_blas():
    about = machine()
    assert about["processor"]
    assert {"python", about["engine"], "numpy", "scipy"} == about["versions"].keys()
    assert about["engine"] == chosen()
    wanted = {
        library.get("architecture") for library in ThreadpoolController().select(user_api="blas").info()
    }
    assert {library["kernels"] for library in about["blas"]} == wanted
