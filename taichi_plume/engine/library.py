"""Names of the chosen engine: all other modules of this package import Taichi, or Quadrants as `taichi`, from here.

`taichi_names` and `quadrants_names` define the same names: those that the two libraries share, and adapters of those
that differ, each with the difference.
"""

from typing import TYPE_CHECKING

from taichi_plume.engine.choice import chosen

NAME = chosen()

if TYPE_CHECKING or NAME == "taichi":
    from taichi_plume.engine.taichi_names import *  # noqa: F403
else:
    from taichi_plume.engine.quadrants_names import *  # noqa: F403
