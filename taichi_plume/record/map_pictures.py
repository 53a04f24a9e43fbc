"""Gas maps and belief maps (posterior of the source position) in the recording, of the first trial."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from taichi_plume.observed.scales import Scale
from taichi_plume.record import drawing, layout, legends, scene
from taichi_plume.record.placement import Stage, picture_format
from taichi_plume.record.stream import Stream
from taichi_plume.scenario.palette import rgb, robot_color
from taichi_plume.scoring.beliefs import beliefs
from taichi_plume.scoring.maps import MapSeries
from taichi_plume.scoring.trials import map_rows
from taichi_plume.time_loop import TimeLoop

RAMP = np.arange(256) / 255


class MapPictures:
    """Recorded pictures (estimate, truth, weight, error) of a run's gas maps; series: the maps' scores over time."""

    STATE = ("sent",)

    def __init__(self, stream: Stream, sim: TimeLoop, stage: Stage, series: list[MapSeries]):
        self.stream, self.maps, self.series = stream, list(sim.maps), series
        gas = Scale(*sim.scenario.recording.range_ppm, "log")
        self.scales = {"estimate": gas, "truth": gas, "weight": legends.WEIGHTS, "error": legends.RATIOS}
        self.colors = {name: drawing.painted(RAMP, palette) for name, palette in scene.ESTIMATES.items()}
        self.sent = [{"forecast": 0, "rows": 0} for _ in self.maps]
        """Number of forecasts and scores of each map that have been sent."""
        made_by = [names for names, _ in map_rows(sim)]
        whose = f", {made_by[0][0]}" if len(made_by) > 1 else ""  # the first trial belongs to the first rival
        for n, model in enumerate(sim.scenario.maps):
            stream.log_still(self._styles(n, model.kind.replace("_", " ") + whose))
        for n, gas_map in enumerate(self.maps):
            blank = _blank(np.shape(gas_map.estimate())[1:], gas_map.cell, (0, 0), stage)
            stream.log_still([(f"maps/{n}/{name}", blank) for name in scene.ESTIMATES])

    def _styles(self, n: int, name: str) -> scene.Entities:
        """Yield the colours and labels of the lines that show the scores of gas map n over time."""
        color = np.array(rgb(robot_color(n)))
        faint = (color * 0.6).astype(np.uint8)
        for entity in self._scored(n):
            label = f"{name}: error" if entity == f"map_errors/{n}_mae" else name
            yield entity, rr.SeriesLines(colors=color, names=label, widths=2.0)
        yield f"map_errors/{n}_forecast", rr.SeriesLines(colors=faint, names=f"{name}: forecast", widths=1.4)

    def _scored(self, n: int) -> list[str]:
        """Return the recording's paths for the scores of gas map n, in the order of layout.MAP_SERIES."""
        return [f"map_errors/{n}_mae", *(f"{origin}/{n}" for origin in list(layout.MAP_SERIES)[1:])]

    def show(self, sim: TimeLoop) -> None:
        """Send the pictures of all gas maps at the present time, and the scores since the last call."""
        low = self.scales["estimate"].low
        for n, gas_map in enumerate(self.maps):
            estimate = np.asarray(gas_map.estimate())[0]
            weight = np.asarray(gas_map.weight(), float)[0]
            truth = self.series[n].truth
            values = {
                "estimate": estimate,
                "truth": truth,
                "weight": np.where(weight > 0, weight, np.nan),
                "error": np.maximum(estimate, low) / np.maximum(truth, low),
            }
            for name, scale in self.scales.items():
                colors = self.colors[name][scale.bytes(values[name])]
                colors[~np.isfinite(values[name])] = 0
                self.stream.picture(sim.t, f"maps/{n}/{name}", drawing.rows(colors))
            self._send_scores(n)

    def _send_scores(self, n: int) -> None:
        series, sent = self.series[n], self.sent[n]
        forecasts = self.maps[n].errors
        fresh = forecasts[sent["forecast"] :]
        self._send_series(f"map_errors/{n}_forecast", [t for t, _ in fresh], [error[0] for _, error in fresh])
        times = series.rows.times[sent["rows"] :].tolist()
        for name, entity in zip(layout.MAP_SERIES.values(), self._scored(n), strict=True):
            self._send_series(entity, times, series.first(name)[sent["rows"] :])
        sent["forecast"], sent["rows"] = len(forecasts), len(series.rows)

    def _send_series(self, entity: str, times: list[float], values: Sequence[float] | np.ndarray) -> None:
        """Send the finite values of a time series to a plot of the recording; times [s]."""
        known = [(t, float(value)) for t, value in zip(times, values, strict=True) if np.isfinite(value)]
        if known:
            t, scalars = zip(*known, strict=True)
            self.stream.send(entity, t, rr.Scalars.columns(scalars=scalars))


class BeliefPictures:
    """Recorded pictures of the source's posterior density [1/m²] as believed by the first robot of each group."""

    STATE = ()

    def __init__(self, stream: Stream, sim: TimeLoop, stage: Stage):
        self.stream = stream
        self.colors = drawing.painted(RAMP, drawing.EMBER)
        for belief in beliefs(sim):
            blank = _blank(belief.p.shape[2:], belief.cell, belief.low, stage)
            stream.log_still([(f"beliefs/{belief.group.number}", blank)])

    def show(self, sim: TimeLoop) -> None:
        """Send the present belief map of the first robot of each group that keeps one."""
        for belief in beliefs(sim):
            density = belief.p[0, 0] / belief.cell**2
            colors = self.colors[drawing.DENSITIES.bytes(density)]
            self.stream.picture(sim.t, f"beliefs/{belief.group.number}", drawing.rows(colors))


def _blank(shape: Sequence[int], cell: float, low: Sequence[float] | np.ndarray, stage: Stage) -> rr.GridMap:
    """Return a coloured picture on the floor, without pixels yet; shape: (nx, ny); low: lower left corner [m]."""
    form = picture_format(shape[0], shape[1], color=True)
    return rr.GridMap.from_fields(format=form, cell_size=cell, translation=[*low, stage.lift])
