"""Gas map from a neighbourhood in space and time: eq 4-7 of `snaps`."""

from math import hypot

from taichi_plume import map_models as models
from taichi_plume.agents.snaps import SnapMap, Stencil

BORDER = 1e-9  # Dist = β is outside, whatever the rounding


class TimeSeriesMap(SnapMap):
    """Forecast from the neighbourhood in space and time, eq 1-7."""

    def __init__(self, model: models.TimeSeriesMap, extent: tuple[float, float], trials: int):
        super().__init__(model, extent, trials, neighbourhood(model))


def neighbourhood(model: models.TimeSeriesMap) -> Stencil:
    """Eq 4, 5 and 7 for every lag and offset inside."""
    reach = int(model.beta / model.alpha / model.cell) + 1
    result: Stencil = []
    lag = 1
    while (age := (1 - model.alpha) * model.time_scale * lag * model.window) < model.beta - BORDER:
        for dx in range(-reach, reach + 1):
            for dy in range(-reach, reach + 1):
                dist = model.alpha * model.cell * hypot(dx, dy) + age
                if dist < model.beta - BORDER:
                    result.append((lag, dx, dy, 1 / dist))
        lag += 1
    return result
