"""Gas map of the last snap's samples alone, by inverse distance: eq 1-3 of `snaps`."""

import numpy as np
import taichi as ti

from taichi_plume.agents.snaps import SnapMap
from taichi_plume.grid.kernels import Template


class InverseDistanceMap(SnapMap):
    """The last snap as it was, S(t) = C(t - 1): what the time series is compared with."""

    def remembered_of(self, lag: np.ndarray, place: np.ndarray) -> np.ndarray:
        """All of the last snap, nothing of those before."""
        return np.where(lag == 1, 1.0, 0.0)

    def _forecast(self) -> None:
        snaps = self.snaps
        _copy(snaps.weighted, snaps.weights, snaps.last, snaps.margin, self.numerator, self.denominator)


@ti.kernel
def _copy(
    weighted: Template, weights: Template, slot: int, margin: int, numerator: Template, denominator: Template
):
    for k, i, j in numerator:
        numerator[k, i, j] = weighted[k, slot, margin + i, margin + j]
        denominator[k, i, j] = weights[k, slot, margin + i, margin + j]
