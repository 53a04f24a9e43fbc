"""How much of a face is open, over the volume that stores the momentum around it."""

from collections.abc import Sequence

import numpy as np

from taichi_plume.grid.grid import Grid


def _widest(area: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The widest passage of the volume around each face, which counts as the volume that stores its momentum.

    However little of a volume is air, it then does not shorten the step; what is steady does not depend on it.
    """
    result = []
    for d, faces in enumerate(area):
        widest = faces.copy()
        for e, others in enumerate(area):
            low = 0.5 * (others + np.roll(others, 1, axis=d))
            widest = np.maximum(widest, np.maximum(low, np.roll(low, -1, axis=e)))
        result.append(np.maximum(widest, 1e-6))
    return result


def opennesses(grid: Grid, area: Sequence[np.ndarray], is_free: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Per axis, area over stored volume, 0 where the velocity is not solved for; padded.

    area: shares of the faces that are air, padded; is_free: of the domain's faces, see `Boundaries`.
    """
    g, result = grid.ghost, []
    for d, widest in enumerate(_widest(area)):
        faces = area[d] / widest
        if not grid.periodic[d]:
            along = np.moveaxis(faces, d, 0)
            for side, face in enumerate((g, g + grid.shape[d])):
                along[face] = (along[face] > 0.0) * np.take(is_free[d], side, axis=d)
        result.append(faces)
    return result
