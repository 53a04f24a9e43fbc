"""Measures of drawn outlines."""

from collections.abc import Sequence

import numpy as np

from taichi_plume.draw.parts import Outline


def surrounding(outlines: Sequence[Outline]) -> np.ndarray:
    """Corners [[x, y], [x, y]] of the box around outlines; there has to be one."""
    points = np.concatenate([outline.points for outline in outlines])
    return np.array([np.nanmin(points, axis=0), np.nanmax(points, axis=0)])
