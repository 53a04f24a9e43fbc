"""Gas maps and belief maps (posterior of the source position) in the recording, of the first trial."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from taichi_plume.grid.grid import centers
from taichi_plume.observed.scales import Scale, rounded_up
from taichi_plume.record import drawing, layout, legends, scene
from taichi_plume.record.pictures import ARROW, KEY, SLOWEST, THIN
from taichi_plume.record.placement import Stage, picture_format
from taichi_plume.record.stream import Stream
from taichi_plume.scenario.palette import rgb, robot_color
from taichi_plume.scoring.beliefs import beliefs
from taichi_plume.scoring.maps import MapSeries
from taichi_plume.scoring.trials import map_rows
from taichi_plume.time_loop import TimeLoop

BRIGHT = (225, 235, 250, 255)  # arrows of wind maps
RAMP = np.arange(256) / 255


class MapPictures:
    """Recorded pictures (estimate, truth, weight, error) of a run's gas maps; series: the maps' scores over time."""

    STATE = ("sent",)

    def __init__(self, stream: Stream, sim: TimeLoop, stage: Stage, series: list[MapSeries]):
        self.stream, self.series = stream, series
        self.maps = {n: each.map for n, each in enumerate(series) if each.quantity == "gas"}
        gas = Scale(*sim.scenario.recording.range_ppm, "log")
        self.scales = {"estimate": gas, "truth": gas, "weight": legends.WEIGHTS, "error": legends.RATIOS}
        self.colors = {name: drawing.painted(RAMP, palette) for name, palette in scene.ESTIMATES.items()}
        self.sent = {n: {"forecast": 0, "rows": 0} for n in self.maps}
        """Number of forecasts and scores of each map that have been sent."""
        made_by = [names for names, _ in map_rows(sim)]
        whose = f", {made_by[0][0]}" if len(made_by) > 1 else ""  # the first trial belongs to the first rival
        for n, gas_map in self.maps.items():
            stream.log_still(self._styles(n, sim.scenario.maps[n].kind.replace("_", " ") + whose))
            blank = _blank(np.shape(gas_map.estimate())[1:3], gas_map.cell, (0, 0), stage)
            for entity, _, _ in layout.map_parts(n, gas_map):
                stream.log_still([(f"{entity}/{name}", blank) for name in scene.ESTIMATES])

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
        for n, gas_map in self.maps.items():
            estimate = np.asarray(gas_map.estimate())[0]
            weight = np.asarray(gas_map.weight(), float)[0]
            truth = self.series[n].truth
            values = {
                "estimate": estimate,
                "truth": truth,
                "weight": np.where(weight > 0, weight, np.nan),
                "error": np.maximum(estimate, low) / np.maximum(truth, low),
            }
            for entity, layer, _ in layout.map_parts(n, gas_map):
                for name, scale in self.scales.items():
                    shown = values[name] if layer is None else values[name][..., layer]
                    colors = self.colors[name][scale.bytes(shown)]
                    colors[~np.isfinite(shown)] = 0
                    self.stream.picture(sim.t, f"{entity}/{name}", drawing.rows(colors))
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


class WindMapArrows:
    """Recorded arrows (estimate, truth) of a run's wind maps; series: the maps' scores over time.

    top: speed [m/s] of the key's arrow, the largest so far; nearly all arrows are shorter.
    """

    STATE = ("sent", "top")

    def __init__(self, stream: Stream, sim: TimeLoop, stage: Stage, series: list[MapSeries]):
        self.stream, self.stage, self.top = stream, stage, 0.0
        self.series = {n: each for n, each in enumerate(series) if each.quantity == "wind"}
        self.sent = dict.fromkeys(self.series, 0)
        """Number of scores of each map that have been sent."""
        for n in self.series:
            color = np.array(rgb(robot_color(n)))
            name = sim.scenario.maps[n].kind.replace("_", " ")
            style = rr.SeriesLines(colors=color, names=name, widths=2.0)
            stream.log_still([(f"wind_map_errors/{n}", style)])

    def show(self, sim: TimeLoop) -> None:
        """Send the arrows of all wind maps at the present time, and the errors since the last call."""
        for n, series in self.series.items():
            winds = {"estimate": np.asarray(series.map.estimate())[0], "truth": series.truth}
            speed = np.linalg.norm(series.truth, axis=-1)
            fast = max(SLOWEST, float(np.quantile(speed, KEY)))
            if fast > self.top:
                self.top = rounded_up(fast)
                look = self.top, ARROW * series.cell, BRIGHT, 1.5 * THIN * series.cell
                for entity, archetype in legends.arrow_key(
                    legends.MAPS, f"{look[0]:g} m/s", *look[1:], self.stage
                ):
                    self.stream.log(sim.t, entity, archetype)
            for name, wind in winds.items():
                self.stream.log(sim.t, f"maps/{n}/{name}", self._arrows(wind, series.cell))
            times, values = series.rows.times[self.sent[n] :], series.first("error_m_s")[self.sent[n] :]
            known = np.isfinite(values)
            if known.any():
                self.stream.send(
                    f"wind_map_errors/{n}", times[known].tolist(), rr.Scalars.columns(scalars=values[known])
                )
            self.sent[n] = len(series.rows)

    def _arrows(self, wind: np.ndarray, cell: float) -> rr.Arrows3D:
        """Return the arrows of a wind (nx, ny, 2) [m/s] on the floor, centred on their cells."""
        known = np.isfinite(wind[..., 0])
        vectors = np.pad(wind[known] * (ARROW * cell / self.top), ((0, 0), (0, 1)))
        middle = np.pad(
            centers(wind.shape[:2], cell)[known], ((0, 0), (0, 1)), constant_values=self.stage.lift
        )
        return rr.Arrows3D(
            origins=middle - vectors / 2, vectors=vectors, colors=BRIGHT, radii=1.5 * THIN * cell
        )


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
