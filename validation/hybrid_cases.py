"""Hybrid experiment: an external robot samples the simulated plume, compared with a simulated robot.

Cabrita, Sousa & Marques, "Player/Stage simulation of olfactory experiments", IROS 2010: a simulated and a hybrid robot
go to the source along similar paths (figure 13, one run each). Here a separate process stands for the real robot, with
its own algorithm and wheels (examples/hybrid_casting.py). Each tick waits for its answer.
"""

import socket
import subprocess
import sys
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import yaml

from taichi_plume.results.run import Run, open_run
from taichi_plume.validation.case import Comparison, Keys
from taichi_plume.validation.experiment import Condition, Experiment, Range, Results
from taichi_plume.validation.plumesim_cases import ALIKE, LAMINAR, PLUME, ROOMBA, arena, in_airs
from taichi_plume.validation.searches import Searches, scenario_of

ROBOT = Path(__file__).resolve().parents[1] / "examples/hybrid_casting.py"
ANSWER_S = 30.0  # wall time, after which a robot counts as lost


def searched(trials: int, takes: str) -> Results:
    """Run trials of robots driven by another process, which sends poses or velocities (`takes`); return the results."""
    data = arena(LAMINAR, PLUME, ROOMBA | {"trials": trials})
    with TemporaryDirectory() as folder:
        searches = Searches()
        searches.add_run(outside(data, takes, Path(folder)))
        return searches.summary(scenario_of(data), f"outside, {takes}")


def outside(data: Keys, takes: str, folder: Path) -> Run:
    """Run a scenario whose robots another process drives; return its results, in `folder`/outside.

    takes: as in `searched`; folder: of the files that the scenario names.
    """
    algorithm = {"kind": "external", "takes": takes, "timeout": ANSWER_S}
    data = data | {"robots": [data["robots"][0] | {"algorithm": algorithm}]}
    port = _free_port()
    (folder / "hybrid.yaml").write_text(yaml.safe_dump(plain(data)), encoding="utf-8")
    service = [
        sys.executable, "-m", "taichi_plume.serve", str(folder / "hybrid.yaml"), "--bind", f"127.0.0.1:{port}",
        "--websocket", "0", "--wait", "--speed", "max", "--no-recording", "--no-report", "--quiet", "--out",
        str(folder / "outside"),
    ]  # fmt: skip
    robot = [sys.executable, str(ROBOT), f"127.0.0.1:{port}", *["--velocity"] * (takes == "velocity")]
    with subprocess.Popen(service, stdout=subprocess.DEVNULL) as serving:
        try:
            subprocess.run(robot, check=True, stdout=subprocess.DEVNULL)
            if serving.wait(ANSWER_S):
                raise RuntimeError(f"the service ended with code {serving.returncode}")
        finally:
            serving.kill()
    return open_run(folder / "outside")


def plain(data: object) -> object:
    """Return data with all tuples replaced by lists, as in YAML."""
    if isinstance(data, dict):
        return {key: plain(value) for key, value in data.items()}
    return [plain(part) for part in data] if isinstance(data, list | tuple) else data


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


FOUND = {"success": Range(least=0.95)}
DISCUSSION = """\
Published is one path to the source per robot, and no figures. Reproduced: external robots, which only receive sensor
readings and only send their poses, find the source as often as the simulated robot and on paths as long. Their
algorithm is an independent NumPy implementation of the same paper. Different are the noise and, for poses, the model
of the wheels. The external robot sends its pose after the readings of a tick, and is sampled there a tick later: a
delay of 0.1 s, while the sensor rises in 3 s.
"""

CASES = (
    Experiment(
        "plumesim_hybrid",
        "a casting Roomba simulated, and as an external process",
        "Cabrita, Sousa & Marques 2010, figure 13",
        (
            Condition("inside", partial(in_airs, data=arena(LAMINAR, PLUME), title="inside"), ALIKE, FOUND),
            Condition("outside, which commands velocities", partial(searched, takes="velocity"), {}, FOUND),
            Condition("outside, which sends poses (hybrid)", partial(searched, takes="pose"), ALIKE, FOUND),
        ),
        evidence="published",
        compared=(Comparison("success of searches", "success", r"inside|outside.*\(hybrid\)", 1.0),),
        test_trials=0,
        discussion=DISCUSSION,
    ),
)
