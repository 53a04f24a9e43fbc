"""Choice of the engine: Taichi, or Quadrants, its maintained fork, for a whole process and its children."""

import os
import sys
from functools import cache
from importlib.util import find_spec
from typing import Literal

from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.terminal import LONGEST_VALUE, visible

VARIABLE = "TAICHI_PLUME_ENGINE"
"""Environment variable with the name of the engine. Worker processes inherit it."""

Arch = Literal["auto", "cpu", "cuda", "vulkan", "metal"]
"""Devices that the user may ask for; auto takes a GPU if there is one."""

DEFAULT = "taichi"
ENGINES = {DEFAULT: "pip install 'taichi>=1.7.4,<1.8'", "quadrants": "pip install 'taichi_plume[quadrants]'"}
"""Name of each engine, and the command that installs it."""


class EngineChoiceError(InputError):
    """Error of an engine that is unknown, not installed, or not the one of this process."""


@cache
def is_installed(name: str) -> bool:
    """Return whether Python finds a package. Studies ask for each of their runs."""
    return name in sys.modules or find_spec(name) is not None


def imported() -> str | None:
    """Return the name of the engine that this process has imported; None if there is none yet."""
    return getattr(sys.modules.get("taichi_plume.engine.library"), "NAME", None)


def chosen() -> str:
    """Return the name of the engine of this process. Raises EngineChoiceError."""
    if name := imported():
        return name
    name = os.environ.get(VARIABLE) or DEFAULT
    if name not in ENGINES:
        raise EngineChoiceError(
            f"{VARIABLE}: got '{visible(name, LONGEST_VALUE)}', allowed are {', '.join(ENGINES)}"
        )
    if not is_installed(name):
        raise EngineChoiceError(f"the engine {name} is not installed: {ENGINES[name]}")
    return name


def choose(name: str) -> None:
    """Choose the engine of this process and its children. Raises EngineChoiceError if another engine is imported."""
    if imported() not in (None, name):
        raise EngineChoiceError(f"this process uses {imported()}; start a new one, with {VARIABLE}={name}")
    os.environ[VARIABLE] = name
