"""Networks that were learnt elsewhere, as ONNX: data, of which nothing is executed but its arithmetic."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.files.own_class import OwnAlgorithmError, content_of
from taichi_plume.guard.terminal import visible

LARGEST = 1 << 28  # bytes
SHOWN = 300  # characters of a message of the runtime's


class NetworkError(OwnAlgorithmError):
    """A network that cannot be read, or does not fit its robots; says which."""


@dataclass(frozen=True)
class Network:
    """From observations (rows, entries), f32, to actions, the first output (rows, numbers).

    entries, numbers: None where the file leaves them open.
    """

    path: Path
    session: Any
    name: str
    entries: int | None
    numbers: int | None

    @classmethod
    def read(cls, path: Path) -> "Network":
        """Raises OwnAlgorithmError, in a line, where the file is none or takes something else."""
        content = content_of(path, LARGEST, f"{LARGEST >> 20} MB; is it a network?")
        session = _session(path, content)
        inputs, outputs = session.get_inputs(), session.get_outputs()
        if len(inputs) != 1 or not outputs:
            raise NetworkError(
                f"{path}: takes {len(inputs)} inputs and gives {len(outputs)} outputs; wanted one input, the "
                "observation, and the action as the first output"
            )
        entries = _columns(path, "input", inputs[0])
        return cls(path, session, inputs[0].name, entries, _columns(path, "output", outputs[0]))

    def fault(self, entries: int, numbers: int) -> str | None:
        """Why it does not fit observations and actions of so many numbers; None where it does."""
        if self.entries not in (None, entries):
            return (
                f"{self.path}: takes {self.entries} numbers, but an observation has {entries}; observe, memory and "
                "history have to be those it was learnt with"
            )
        if self.numbers not in (None, numbers):
            return (
                f"{self.path}: gives {self.numbers} numbers, but an action has {numbers}; act and declares have to be "
                "those it was learnt with"
            )
        return None

    def act(self, observations: np.ndarray, numbers: int) -> np.ndarray:
        """Actions (rows, numbers) f32, within -1 and 1. Raises OwnAlgorithmError where the network gives none."""
        try:
            told = self.session.run(None, {self.name: observations})[0]
        except Exception as error:
            raise OwnAlgorithmError(
                f"{self.path}: cannot be evaluated: {visible(' '.join(str(error).split()), SHOWN)}"
            ) from None
        told = np.asarray(told)
        if told.shape != (len(observations), numbers):
            raise OwnAlgorithmError(
                f"{self.path}: gives {told.shape} for {len(observations)} observations; wanted "
                f"{(len(observations), numbers)}"
            )
        if not np.isfinite(told).all():
            row = int(np.flatnonzero(~np.isfinite(told).all(axis=1))[0])
            raise OwnAlgorithmError(f"{self.path}: gives what is no number for robot {row}")
        return np.clip(told, -1.0, 1.0).astype(np.float32)


def _session(path: Path, content: bytes) -> Any:
    """Evaluates the network on one thread, always in the same order. Raises NetworkError."""
    try:
        import onnxruntime
    except ImportError:
        raise NetworkError(
            f'{path}: onnxruntime is not installed, which runs networks; pip install "taichi_plume[learn]"'
        ) from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.use_deterministic_compute = True
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # of many kinds, which are no classes of their own
        told = " ".join(str(error).split())
        hint = "; its weights lie in another file, export all into one" if "external" in told.lower() else ""
        raise NetworkError(
            f"{path}: is no network of ONNX that can be run: {visible(told, SHOWN)}{hint}"
        ) from None


def _columns(path: Path, what: str, told: Any) -> int | None:
    """Numbers of a row of the input or output; None where it is open. Raises NetworkError."""
    if told.type != "tensor(float)":
        raise NetworkError(f"{path}: its {what} is a {told.type}; wanted 32-bit floats")
    shape = list(told.shape or [])
    if len(shape) != 2 or isinstance(shape[0], int):
        raise NetworkError(
            f"{path}: its {what} has the shape {shape}; wanted (rows, numbers) with any number of rows (a dynamic axis)"
        )
    return shape[1] if isinstance(shape[1], int) else None
