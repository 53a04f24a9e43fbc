"""Gas map of the last snap's samples alone, by inverse distance: eq 1-3 of `snaps`."""

from taichi_plume import map_models as models
from taichi_plume.agents.snaps import SnapMap


class InverseDistanceMap(SnapMap):
    """Interpolation of the last snap's samples, eq 1-3: what the time series is compared with."""

    def __init__(self, model: models.InverseDistanceMap, extent: tuple[float, float], trials: int):
        super().__init__(model, extent, trials, [(1, 0, 0, 1.0)])
