"""Figures 12 and 13 of PlumeSim: the plume that a sensor network measures, and one search of each kind.

Cabrita, Sousa & Marques, "Player/Stage simulation of olfactory experiments", IROS 2010. Figure 12 draws the stable
plume of the arena, as its sensor network measured it, beside the simulated plume from Fluent; the paper finds the two
very similar. Figure 13 overlays the odometry of one simulated, one hybrid and one real search; the paper finds the
paths very similar. No figures are given, nor are the number and the positions of the nodes.

Here the turbulent arena stands for the real one. A network of 21 nodes (configs/sensor_network.yaml) records its plume;
the log of their readings is played back. The simulated plume is PSFluent, of another flow realisation. Expected
beforehand: the mean readings of the nodes correlate with the simulated plume by 0.9 or more, and their sum equals that
of the simulated plume within a factor of two, as is asked of dispersion models (Chang & Hanna 2004,
doi:10.1007/s00703-003-0070-7). All three robots, from one start, arrive, and their paths are nearer to each other than
half a first cast (0.3 m).
"""

import subprocess
import sys
from functools import cache
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import yaml
from scipy.spatial import KDTree

from taichi_plume.assembly.assemble import assemble
from taichi_plume.files.plumesim_log import read_log
from taichi_plume.grid.fields import ppm_at
from taichi_plume.results.network_log import log_of
from taichi_plume.results.run import Run, open_run
from taichi_plume.time_loop import Every
from taichi_plume.validation.case import Keys
from taichi_plume.validation.experiment import Condition, Experiment, Mean, Plume, Range, Results, Tracks
from taichi_plume.validation.hybrid_cases import outside, plain
from taichi_plume.validation.plumesim_cases import (
    AT_ONCE,
    FRAMES,
    GRID_GAS,
    LAMINAR,
    LOG,
    ROOMBA,
    SCALE,
    SOURCE,
    TARGET,
    TURBULENT,
    arena,
    export,
    recorded,
)
from taichi_plume.validation.searches import scenario_of

DISCUSSION = """\
Reproduced: the readings of the 21 nodes correlate with the simulated plume by 0.99, and the three robots arrive along
paths that are 0.2 m from each other. The real path is longer, 1.5 of the straight way, where the others have 1.3. The
sum of the nodes is 1.6 times that of the simulated plume, another flow realisation. The measured plume looks wider, as
a reading stands for the square of 0.5 m around its node.

The paper gives neither numbers nor the places of its nodes; one run of each kind, as there, says nothing about others.
"""
SIZE = (4.0, 3.0)  # m, of the arena
STABLE = 30.0  # s, after which the nodes' sensors have settled and the robots start
MEAN = 60.0  # s, over which plumes are averaged
CELL = 0.1  # m, of the pictures
NODES = np.stack(np.meshgrid(np.linspace(0.5, 3.5, 7), [1.0, 1.5, 2.0], indexing="ij"), axis=-1).reshape(
    -1, 2
)
START = {"start": {"kind": "positions", "positions": [[3.7, 0.4]], "heading_deg": 180.0}}
ODOMETRY = {"localization": {"kind": "odometry"}}  # of wheel encoders that are not calibrated
NETWORK = ROOMBA | {
    "name": "nodes",
    "count": len(NODES),
    "start": {"kind": "positions", "positions": NODES.tolist(), "heading_deg": 0.0},
    "algorithm": {"kind": "casting", "speed": 0.0},
    "body": {"radius": 0.05},
    "reach": 0.0,
}


def ran(data: Keys, folder: Path) -> Run:
    """Run a scenario by the command, in a process of its own; return its results, in `folder`/run."""
    file = folder / "scenario.yaml"
    file.write_text(yaml.safe_dump(plain(data)), encoding="utf-8")
    options = ["--no-recording", "--no-report", "--quiet", "--out", str(folder / "run")]
    subprocess.run([sys.executable, "-m", "taichi_plume.run", str(file), *options], check=True)
    return open_run(folder / "run")


@cache
def real() -> tuple[str, np.ndarray]:
    """Return the log of the network in the turbulent arena, and the path of a Roomba that starts at STABLE."""
    robots = [ROOMBA | START | ODOMETRY | {"begin": STABLE}, NETWORK]
    data = arena(TURBULENT, GRID_GAS) | {"robots": robots, "rivals": True, "duration": STABLE + 90.0}
    with TemporaryDirectory() as folder:
        run = ran(data, Path(folder))
        return "".join(log_of(run)), path_of(run)


def path_of(run: Run) -> np.ndarray:
    """Return the path (n, 2) [m] of a run's Roomba, as its odometry has it, until it has found the source."""
    robots = run.robots
    rows = robots[(robots["group"] == "roomba") & ~robots["found"]]
    return rows[["believed_x", "believed_y"]].to_numpy(float)


def fluent(folder: Path) -> Keys:
    """Write the simulated plume into `folder` as Fluent files; return the gas that plays them back."""
    (folder / LOG).write_bytes(recorded(1))
    export(read_log(folder / LOG), folder)
    return {"kind": "fluent", "files": FRAMES, "largest": SCALE, "start": STABLE, **TARGET}


def mean_plume(gas: Keys, folder: Path, points: np.ndarray) -> np.ndarray:
    """Return the mean concentration [ppm] at points (n, 2) [m] over MEAN, of a gas that files in `folder` hold."""
    data = arena(LAMINAR, gas | {"interpolate": True}) | {"robots": [], "duration": MEAN}
    sim = assemble(scenario_of(data, folder), folder)
    seen: list[np.ndarray] = []
    sim.observers.append(Every(1.0, lambda sim: seen.append(ppm_at(sim.gas, points, sim.t)[:, 0])))
    sim.run()
    return np.mean(seen, axis=0)


def plumes(trials: int) -> Results:
    """Return figure 12, measured and simulated, and what the nodes say of both."""
    axes = [CELL * (np.arange(round(width / CELL)) + 0.5) for width in SIZE]
    cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    points = np.concatenate([cells.reshape(-1, 2), NODES])
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "network.pslog").write_text(real()[0], encoding="ascii")
        log = {"kind": "plumesim_log", "file": "network.pslog", "start": STABLE, **TARGET}
        both = {
            "figure 12, measured by the network": mean_plume(log, folder, points),
            "figure 12, simulated": mean_plume(fluent(folder), folder, points),
        }
    measured, simulated = (plume[-len(NODES) :] for plume in both.values())
    n = len(NODES)
    return {
        "correlation of the nodes": Mean(float(np.corrcoef(measured, simulated)[0, 1]), None, None, n),
        "sum of the nodes, measured / simulated": Mean(
            float(measured.sum() / simulated.sum()), None, None, n
        ),
        **{
            title: Plume(SIZE, SOURCE, NODES, plume[:-n].reshape(cells.shape[:2]))
            for title, plume in both.items()
        },
    }


def paths(trials: int) -> Results:
    """Return figure 13, the odometry of a simulated, a hybrid and a real search from one start."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        gas = fluent(folder)
        inside = path_of(ran(arena(LAMINAR, gas, AT_ONCE | START | ODOMETRY), folder))
        hybrid = outside(arena(LAMINAR, gas, AT_ONCE | START), "pose", folder)
        ways = {"simulated": inside, "hybrid": path_of(hybrid), "real": real()[1]}
    apart = [
        np.concatenate([KDTree(a).query(b)[0], KDTree(b).query(a)[0]]).mean()
        for a, b in combinations(ways.values(), 2)
    ]
    straight = {name: float(np.hypot(*(way[0] - SOURCE))) for name, way in ways.items()}
    lengths = {name: float(np.hypot(*np.diff(way, axis=0).T).sum()) for name, way in ways.items()}
    return {
        "farthest end from the source [m]": Mean(
            max(float(np.hypot(*(way[-1] - SOURCE))) for way in ways.values()), None, None, len(ways)
        ),
        "distance of the paths [m]": Mean(float(np.mean(apart)), None, None, len(apart)),
        **{
            f"path / straight way, {name}": Mean(lengths[name] / straight[name], None, None, 1)
            for name in ways
        },
        "figure 13, odometry": Tracks(SIZE, SOURCE, tuple(ways.values()), tuple(ways)),
    }


CASES = (
    Experiment(
        "plumesim_figures",
        "the plume that a sensor network measures beside the simulated one, and three paths in one picture",
        "Cabrita, Sousa & Marques 2010, figures 12 and 13",
        (
            Condition(
                "figure 12, one air each",
                plumes,
                {"correlation of the nodes": "very similar plumes"},
                {
                    "correlation of the nodes": Range(least=0.9),
                    "sum of the nodes, measured / simulated": Range(0.5, 2.0),
                },
            ),
            Condition(
                "figure 13, one run each",
                paths,
                {"distance of the paths [m]": "very similar trajectories"},
                {
                    "farthest end from the source [m]": Range(most=1.0),
                    "distance of the paths [m]": Range(most=0.3),
                },
            ),
        ),
        evidence="published",
        compared="compares pictures of the paper by eye; correlations and distances are between runs of ours",
        trials=1,
        test_trials=0,
        discussion=DISCUSSION,
    ),
)
