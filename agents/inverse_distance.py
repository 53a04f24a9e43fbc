"""Gas map of the last snap's samples alone, by inverse distance: eq 1-3 of `snaps`."""

from taichi_plume.agents.snaps import SnapMap


class InverseDistanceMap(SnapMap):
    """The last snap as it was, S(t) = C(t - 1): what the time series is compared with."""

    def _forecast(self) -> None:
        self.numerator.copy_from(self.weighted)
        self.denominator.copy_from(self.weights)
