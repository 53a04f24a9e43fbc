"""Networks are evaluated in a process of their own, to the bit as here, and a hostile one only ends that process."""

import os
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taichi_plume.files import network
from taichi_plume.files.network import Network, NetworkError
from taichi_plume.files.own_class import OwnAlgorithmError

pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")
hostile = import_module("hostile_networks")

OBSERVATIONS = np.random.default_rng(1).normal(size=(50, 7)).astype(np.float32)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """A limit that is reached soon."""
    monkeypatch.setattr(network, "SECONDS", 0.2)


def test_actions_are_those_of_the_runtime_to_the_bit(tmp_path: Path) -> None:
    made = hostile.plain()
    made.graph.initializer[0].CopyFrom(hostile.constant("w", OBSERVATIONS[:7, :2]))
    path = hostile.save(made, tmp_path / "x.onnx")
    here = onnxruntime.InferenceSession(path.read_bytes(), providers=["CPUExecutionProvider"])
    there = Network.read(path)
    for rows in (1, 50):
        wanted = np.clip(here.run(None, {"observation": OBSERVATIONS[:rows]})[0], -1.0, 1.0)
        assert there.act(OBSERVATIONS[:rows], 2).tobytes() == wanted.tobytes()
    assert Network.read(path).evaluator is there.evaluator  # one process for all robots with this network


def test_an_endless_loop_is_ended(tmp_path: Path, quick: Any) -> None:
    there = Network.read(hostile.save(hostile.endless(), tmp_path / "x.onnx"))
    with pytest.raises(OwnAlgorithmError, match=r"x\.onnx: cannot be evaluated: takes more than 0 s"):
        there.act(OBSERVATIONS, 2)
    with pytest.raises(OwnAlgorithmError, match="cannot be evaluated"):  # and not for ever
        there.act(OBSERVATIONS, 2)


def test_loading_ends_too(tmp_path: Path, quick: Any) -> None:
    with pytest.raises(NetworkError, match=r"x\.onnx: takes more than 0 s .*, only to be loaded"):
        Network.read(hostile.save(hostile.nested_functions(), tmp_path / "x.onnx"))


@pytest.mark.parametrize("made", [lambda: hostile.large(2**29), hostile.large, hostile.large_evaluated])
def test_memory_is_limited(tmp_path: Path, made: Any) -> None:
    with pytest.raises(OwnAlgorithmError, match=r"x\.onnx: .*(memory|bytes)"):
        Network.read(hostile.save(made(), tmp_path / "x.onnx")).act(OBSERVATIONS, 2)


@pytest.mark.parametrize("location", ["w.bin", "../w.bin", "{}/w.bin", "none.bin"])
def test_weights_in_other_files_are_refused(tmp_path, monkeypatch, location):
    """They would be looked for in the working folder, and be in no manifest."""
    (tmp_path / "below").mkdir()
    for folder in (tmp_path, tmp_path / "below"):
        (folder / "w.bin").write_bytes(np.ones((7, 2), np.float32).tobytes())
    monkeypatch.chdir(tmp_path / "below")
    made = hostile.external(location.format(tmp_path))
    with pytest.raises(NetworkError, match=r"x\.onnx: its weights lie in another file .external data."):
        Network.read(hostile.save(made, tmp_path / "below/x.onnx"))


def test_processes_end_with_their_networks(tmp_path: Path) -> None:
    there = Network.read(hostile.save(hostile.plain(), tmp_path / "x.onnx"))
    number = there.evaluator.process._process.pid
    del there
    for _ in range(100):
        try:
            os.kill(number, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    raise AssertionError("the process is still there")
