"""Learnt policies as robot controllers: neural networks in ONNX files, evaluated in a confined process.

ONNX has loops, so a network may run forever or fill the memory, even while loading (constant folding). Hence
onnxruntime runs in a process with limits on time and memory, which can open no file: weights in other files (external
data) and libraries of operators are refused.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from taichi_plume.files.own_class import OwnAlgorithmError
from taichi_plume.guard.safe_open import content_of
from taichi_plume.guard.sandbox import MIB, ConfinedError, ConfinedProcess, Limits
from taichi_plume.guard.terminal import visible

LARGEST = 1 << 28  # bytes
SECONDS, SECONDS_PER_MIB = 4.0, 1.0  # computing time of one evaluation, or of loading
MEMORY, MEMORY_PER_BYTE = 512 * MIB, 16
EXTERNAL = ("external data", "systemerror : 24")  # in messages of the runtime, if weights lie in another file
SHOWN = 300  # characters of a message of the runtime's


class NetworkError(OwnAlgorithmError):
    """Error: a neural network cannot be read, or does not fit the robots."""


@dataclass(frozen=True)
class Network:
    """ONNX policy that maps observations (rows, entries), f32, to actions, its first output (rows, numbers).

    entries, numbers: None if the file leaves the size open.
    """

    path: Path
    evaluator: "_Evaluator"
    entries: int | None
    numbers: int | None

    @classmethod
    def read(cls, path: Path) -> "Network":
        """Read a policy from an ONNX file. Raises OwnAlgorithmError, in a line, if it is none or has other inputs."""
        content = content_of(path, LARGEST, OwnAlgorithmError)
        evaluator, inputs, outputs = _evaluator(path, content)
        if len(inputs) != 1 or not outputs:
            raise NetworkError(
                f"{path}: takes {len(inputs)} inputs and gives {len(outputs)} outputs; wanted one input, the "
                "observation, and the action as the first output"
            )
        return cls(path, evaluator, _columns(path, "input", inputs[0]), _columns(path, "output", outputs[0]))

    def fault(self, entries: int, numbers: int) -> str | None:
        """Return an error if the network does not take `entries` inputs or give `numbers` outputs; else None."""
        if self.entries not in (None, entries):
            what = f"takes {self.entries} numbers, an observation has {entries}; observe, memory and history"
        elif self.numbers not in (None, numbers):
            what = f"gives {self.numbers} numbers, an action has {numbers}; act and declares"
        else:
            return None
        return f"{self.path}: {what} have to be those it was learnt with"

    def act(self, observations: np.ndarray, numbers: int) -> np.ndarray:
        """Return actions (rows, numbers) f32, clipped to -1 to 1, for observations. Raises OwnAlgorithmError."""
        try:
            actions = self.evaluator.call(_evaluate, observations)
        except Exception as error:  # the runtime has many kinds of errors
            message = visible(" ".join(str(error).split()), SHOWN)
            raise OwnAlgorithmError(f"{self.path}: cannot be evaluated: {message}") from None
        rows = len(observations)
        if actions.shape != (rows, numbers):
            raise OwnAlgorithmError(
                f"{self.path}: gives {actions.shape} for {rows} observations; wanted {(rows, numbers)}"
            )
        if not np.isfinite(actions).all():
            row = int(np.flatnonzero(~np.isfinite(actions).all(axis=1))[0])
            raise OwnAlgorithmError(f"{self.path}: gives what is no number for robot {row}")
        return np.clip(actions, -1.0, 1.0).astype(np.float32)


class _Evaluator:
    """Child process that evaluates one neural network. ends: names, types and shapes of inputs and outputs."""

    def __init__(self, content: bytes):
        mib = len(content) / MIB
        self.limits = Limits(SECONDS + SECONDS_PER_MIB * mib, MEMORY + MEMORY_PER_BYTE * len(content))
        self.process = ConfinedProcess("numpy", "onnxruntime")
        self.ends: tuple[list[_End], list[_End]] = self.call(_load, content)

    def call(self, function: Callable[..., Any], argument: object) -> Any:
        """Call a function with an argument in the child process, with limits, and return its result."""
        return self.process.call(function, argument, limits=self.limits)


_End = tuple[str, str, list[object]]
_evaluators: "WeakValueDictionary[bytes, _Evaluator]" = WeakValueDictionary()  # by the digest of the file


def _evaluator(path: Path, content: bytes) -> tuple[_Evaluator, list[_End], list[_End]]:
    """Return the child process of a network, shared by all robots, and its inputs, outputs. Raises NetworkError."""
    digest = hashlib.sha256(content).digest()
    evaluator = _evaluators.get(digest)
    if evaluator is None or not evaluator.process.close.alive:
        try:
            _evaluators[digest] = evaluator = _Evaluator(content)
        except ImportError:
            raise NetworkError(
                f'{path}: onnxruntime is not installed, which runs networks; pip install "taichi_plume[learn]"'
            ) from None
        except ConfinedError as error:
            raise NetworkError(f"{path}: {error}, only to be loaded; is it a policy?") from None
        except Exception as error:  # the runtime has many kinds of errors, without a common class
            message = " ".join(str(error).split())
            what = f"is no network of ONNX that can be run: {visible(message, SHOWN)}"
            if any(text in message.lower() for text in EXTERNAL):
                what = "its weights lie in another file (external data); export the network into one file"
            raise NetworkError(f"{path}: {what}") from None
    return evaluator, *evaluator.ends


_session: Any = None  # session of the process that evaluates


def _load(content: bytes) -> tuple[list[_End], list[_End]]:
    """Child side: load the network for deterministic, single-threaded evaluation; return its inputs and outputs."""
    import onnxruntime

    global _session
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.use_deterministic_compute = True
    options.log_severity_level = 4
    _session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    inputs, outputs = (
        [(end.name, end.type, list(end.shape or [])) for end in ends]
        for ends in (_session.get_inputs(), _session.get_outputs())
    )
    return inputs, outputs


def _evaluate(observations: np.ndarray) -> np.ndarray:
    """Child side: return the first output of the loaded network for observations."""
    return np.asarray(_session.run(None, {_session.get_inputs()[0].name: observations})[0])


def _columns(path: Path, what: str, end: _End) -> int | None:
    """Return the row length of a network's input or output; None if left open. Raises NetworkError."""
    _, kind, shape = end
    if kind != "tensor(float)":
        raise NetworkError(f"{path}: its {what} is a {kind}; wanted 32-bit floats")
    if len(shape) != 2 or isinstance(shape[0], int):
        raise NetworkError(
            f"{path}: its {what} has the shape {shape}; wanted (rows, numbers) with any number of rows (a dynamic axis)"
        )
    return shape[1] if isinstance(shape[1], int) else None
