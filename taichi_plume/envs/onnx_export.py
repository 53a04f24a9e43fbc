"""Export of trained policies to ONNX files, which the algorithm `{kind: policy, file: ...}` runs in any scenario."""

from copy import deepcopy
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from taichi_plume.envs.task import require
from taichi_plume.files.disk import written_whole
from taichi_plume.guard.safe_open import as_path
from taichi_plume.guard.terminal import visible


def export_onnx(policy: Any, path: Path | str, entries: int | None = None) -> Path:
    """Write a policy to an ONNX file of one input, `observation`, and one output, `action`; see `envs.export_onnx`."""
    path = as_path(path, "path")
    for package in ("torch", "onnx", "onnxscript"):
        require(package)
    import torch  # pyright: ignore[reportMissingImports]

    layers, entries = _layers(policy, entries)

    class Actor(torch.nn.Module):
        """Action of a policy without exploration noise, clipped to the range of actions."""

        def __init__(self) -> None:
            super().__init__()
            self.layers = deepcopy(torch.nn.Sequential(*layers)).cpu()  # the user's policy stays as it is

        def forward(self, observation: Any) -> Any:
            return torch.clamp(self.layers(observation), -1.0, 1.0)

    with TemporaryDirectory() as folder:
        file = Path(folder) / "policy.onnx"
        torch.onnx.export(
            Actor().eval(),
            (torch.zeros(2, entries),),
            str(file),
            input_names=["observation"],
            output_names=["action"],
            dynamic_shapes={"observation": {0: torch.export.Dim("batch")}},
            dynamo=True,
            external_data=False,
            verbose=False,
        )
        content = file.read_bytes()
    with written_whole(path) as fresh:
        fresh.write_bytes(content)
    return path


def _layers(policy: Any, entries: int | None) -> tuple[list[Any], int]:
    """Return the modules of a policy from observation to action, and the number of entries of an observation."""
    import torch  # pyright: ignore[reportMissingImports]

    if isinstance(policy, torch.nn.Module):
        if entries is None:
            raise ValueError(
                "entries: give the number of entries of an observation, which a module does not state"
            )
        return [policy], entries
    network = getattr(policy, "policy", None)
    if not hasattr(network, "pi_features_extractor"):
        kind = visible(type(policy).__name__)
        raise ValueError(f"policy: got {kind}, must be a model of PPO or A2C, or a torch.nn.Module")
    layers = [network.pi_features_extractor, network.mlp_extractor.policy_net, network.action_net]
    return layers, int(policy.observation_space.shape[0])
