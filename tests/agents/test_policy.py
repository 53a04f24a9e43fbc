"""Policies that run from a file do what their network says, of what robots observe."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from robots import room, team

from taichi_plume.assembly.assemble import assemble
from taichi_plume.assembly.preparation import checked, load
from taichi_plume.cli import run
from taichi_plume.files.network import Network
from taichi_plume.files.own_class import OwnAlgorithmError
from taichi_plume.grid.state import State
from taichi_plume.scenario.loading import ScenarioError
from taichi_plume.scenario.scenario import Scenario

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")
pytestmark = [pytest.mark.usefixtures("taichi"), pytest.mark.slow]

OBSERVE = ["wind", "gas", "bumper", "action"]  # upwind ahead, left, speed, gas, bumper, last speed and turn


def network(path: Path, weights: Any, bias: Any, rows: Any = "rows", kind: int | None = None) -> Path:
    """Actions that are linear in observations, as a file."""
    from onnx import TensorProto, helper, numpy_helper

    kind = kind or TensorProto.FLOAT
    dtype = helper.tensor_dtype_to_np_dtype(kind)
    weights, bias = np.asarray(weights, dtype), np.asarray(bias, dtype)
    ends = [("observation", len(weights)), ("action", len(bias))]
    reported = [helper.make_tensor_value_info(name, kind, [rows, size]) for name, size in ends]
    node = helper.make_node("Gemm", ["observation", "w", "b"], ["action"])
    given = [numpy_helper.from_array(weights, "w"), numpy_helper.from_array(bias, "b")]
    graph = helper.make_graph([node], "linear", reported[:1], reported[1:], given)
    opset = [helper.make_opsetid("", 17)]
    onnx.save(helper.make_model(graph, opset_imports=opset, ir_version=8), path)
    return path


def upwind(size: int = 7) -> tuple[np.ndarray, np.ndarray]:
    """Turn to where the wind comes from, and drive at three quarters of the speed."""
    weights = np.zeros((size, 2))
    weights[1, 1] = 0.3
    return weights, np.array([0.5, 0.0])


def scenario(**keys: Any) -> Scenario:
    policy = {"kind": "policy", "file": "x.onnx", "observe": OBSERVE, "period": 0.3, **keys}
    sensors = {"wind": {"kind": "ideal"}}
    learnt = team([3.0, 1.0], [3.0, 2.0], trials=2, heading_deg=90, algorithm=policy, sensors=sensors)
    return Scenario.model_validate(room(learnt, duration=6, tick=0.1))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("policy")
    network(path / "x.onnx", *upwind())
    return path


@pytest.fixture(scope="module")
def sim(taichi: Any, folder: Path) -> Any:
    return assemble(scenario(), folder)


def test_the_network_drives(sim: Any) -> None:
    """Against an integration in NumPy of the same law: heading to upwind, decided every third tick."""
    sim.reset()
    heading, rate = np.pi / 2, 0.0
    for tick in range(1, 41):
        sim.advance()
        heading += 0.1 * rate
        if (tick - 1) % 3 == 0:
            left = -np.sin(np.pi - heading) * -1.0
            rate = 0.3 * left * np.pi
        now = sim.swarm.snapshot()["heading"]
        assert now == pytest.approx(np.full(4, heading), abs=1e-4)
    assert sim.swarm.speed_command.to_numpy()[:4] == pytest.approx(0.75 * 0.2)


def test_it_observes_its_last_action(sim: Any) -> None:
    sim.reset()
    for _ in range(4):  # the second decision
        sim.advance()
    algorithm = sim.teams[0].algorithm
    seen = dict(zip(algorithm.observation.names, algorithm.observations[0], strict=True))
    assert seen["last speed"] == pytest.approx(0.5)
    assert seen["last turn"] == pytest.approx(0.3)


def test_it_goes_on_from_a_checkpoint(sim: Any) -> None:
    sim.reset()
    state = State(sim)
    for _ in range(10):
        sim.advance()
    kept = state.save()
    ends = []
    for _ in range(2):
        for _ in range(14):
            sim.advance()
        ends.append(sim.swarm.snapshot()["position"])
        state.restore(kept)
    assert (ends[0] == ends[1]).all()


@pytest.mark.parametrize(
    ("made", "keys", "reported"),
    [
        (lambda file: network(file, *upwind(9)), {}, "takes 9 numbers, an observation has 7"),
        (
            lambda file: network(file, np.zeros((7, 3)), np.zeros(3)),
            {},
            "gives 3 numbers, an action has 2",
        ),
        (lambda file: network(file, *upwind()), {"declares": True}, "has 8"),
        (lambda file: network(file, *upwind(), rows=1), {}, "any number of rows"),
        (lambda file: network(file, *upwind(), kind=11), {}, "32-bit floats"),
        (lambda file: file.write_bytes(b"no network"), {}, "is no network of ONNX"),
        (lambda file: None, {}, "No such file"),
    ],
)
def test_what_does_not_fit_is_reported(tmp_path: Path, made: Any, keys: Any, reported: str) -> None:
    made(tmp_path / "x.onnx")
    with pytest.raises(ScenarioError) as caught:
        assemble(checked(scenario(**keys), tmp_path).scenario, tmp_path)
    (line,) = caught.value.faults
    assert reported in line
    assert line.startswith("robots[0].algorithm.file: ")
    assert "x.onnx" in line


def test_no_number_ends_the_run(sim: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    weights, bias = upwind()
    file = network(tmp_path / "x.onnx", weights, bias * np.nan)
    sim.reset()
    monkeypatch.setattr(sim.teams[0].algorithm, "network", Network.read(file))
    with pytest.raises(OwnAlgorithmError, match=r"x\.onnx: gives what is no number for robot 0"):
        sim.advance()


def test_a_run_needs_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "task.yaml"
    file.write_text(json.dumps(room(team([3.0, 1.0], algorithm={"kind": "policy"}), duration=1)))
    load(file)  # it is a task, and nothing is wrong with it
    assert run.main([str(file), "--out", str(tmp_path / "out")]) == 2
    *notes, error = capsys.readouterr().err.strip().splitlines()
    assert "still to be learnt" in error
    assert all(line.startswith("note: ") for line in notes)
