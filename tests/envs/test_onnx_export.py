"""Trained policies become ONNX files that give the same actions."""

from types import SimpleNamespace

import numpy as np
import pytest

from taichi_plume.envs import export_onnx
from taichi_plume.files.network import Network
from taichi_plume.guard.input_error import InputError


def test_a_missing_package_is_named_with_its_extra(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r'torch is not installed; pip install "taichi_plume\[learn\]"'):
        export_onnx(SimpleNamespace(), tmp_path / "policy.onnx")


@pytest.mark.parametrize("path", [5, "a\0.onnx", b"policy.onnx"])
def test_a_path_that_no_file_can_have_is_refused(path):
    with pytest.raises(InputError) as error:
        export_onnx(SimpleNamespace(), path)
    (line,) = error.value.lines
    assert line.startswith("path: got ")


def test_other_policies_are_refused(tmp_path):
    torch = pytest.importorskip("torch")
    pytest.importorskip("onnxscript")
    for policy, text in (
        (SimpleNamespace(), "policy: got SimpleNamespace"),
        (torch.nn.Linear(3, 2), "entries: "),
    ):
        with pytest.raises(ValueError, match=text):
            export_onnx(policy, tmp_path / "policy.onnx")
    assert not list(tmp_path.iterdir())


def test_a_module_keeps_its_actions(tmp_path):
    torch = pytest.importorskip("torch")
    pytest.importorskip("onnxscript")
    torch.manual_seed(1)
    module = torch.nn.Sequential(torch.nn.Linear(5, 8), torch.nn.Tanh(), torch.nn.Linear(8, 2)).train()
    module[2].weight.data *= 4.0  # some actions lie beyond the limits
    path = export_onnx(module, str(tmp_path / "policy.onnx"), 5)
    assert module.training
    network = Network.read(path)
    assert network.fault(5, 2) is None
    observations = np.random.default_rng(1).normal(scale=4.0, size=(64, 5)).astype(np.float32)
    expected = module(torch.from_numpy(observations)).detach().numpy().clip(-1.0, 1.0)
    assert (np.abs(expected) == 1.0).any()
    np.testing.assert_allclose(network.act(observations, 2), expected, atol=1e-5)


def test_a_model_of_stable_baselines3_keeps_its_actions(tmp_path):
    pytest.importorskip("onnxscript")
    baselines = pytest.importorskip("stable_baselines3")
    gymnasium = pytest.importorskip("gymnasium")

    class Still(gymnasium.Env):
        """An environment in which nothing happens."""

        observation_space = gymnasium.spaces.Box(-1.0, 1.0, (4,), np.float32)
        action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)

    model = baselines.PPO("MlpPolicy", Still(), device="cpu", seed=1)
    network = Network.read(export_onnx(model, tmp_path / "policy.onnx"))
    observations = np.random.default_rng(1).uniform(-1.0, 1.0, (64, 4)).astype(np.float32)
    expected, _ = model.predict(observations, deterministic=True)
    np.testing.assert_allclose(network.act(observations, 2), expected, atol=1e-5)
    with pytest.raises(ValueError, match="policy: got SAC"):
        export_onnx(baselines.SAC("MlpPolicy", Still(), device="cpu"), tmp_path / "other.onnx")
