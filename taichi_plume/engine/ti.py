"""Taichi's names, with the engine's fields and kernels: all other modules import `ti` from here."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taichi import *  # noqa: F403  # pyright: ignore[reportAssignmentType]

from taichi_plume.engine.cells import along, cell, load_numbers, row  # noqa: F401
from taichi_plume.engine.device_loops import barrier  # noqa: F401
from taichi_plume.engine.fields import field, filled, filled_vectors, shared_memory, vector_field  # noqa: F401
from taichi_plume.engine.kernels import kernel  # noqa: F401
from taichi_plume.engine.library import func, taichi  # noqa: F401
from taichi_plume.engine.replacements import static  # noqa: F401


def __getattr__(name: str) -> Any:
    value = getattr(taichi, name)
    if name != "cfg":  # a new object after each `init`
        globals()[name] = value
    return value
