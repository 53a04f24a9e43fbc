"""How the viewer lays a recording out: views, cameras, panels. For rerun, as `recording` and `scene`."""

from typing import Any

import numpy as np
import rerun.blueprint as rrb

from taichi_plume.record import drawing
from taichi_plume.record.scene import ESTIMATES, Stage
from taichi_plume.simulation import Simulation, Uncertain

TIME = "sim_time"
TRAIL = 30.0  # s
MOST_LANES = 12  # behaviour lanes and entries of a legend that one can still read
MAP_SERIES = {
    "map_errors": "error_ppm",
    "map_correlations": "correlation",
    "map_peaks": "peak_distance_m",
    "map_surprises": "nlpd",
}
"""Where the scores of maps are (see `map_scores`), the error first."""
MAP_TITLES = ("Error [ppm]", "Correlation", "Peak to source [m]", "NLPD of the next readings")
BACKGROUND = (24, 26, 32)


def blueprint(
    sim: Simulation, stage: Stage, robots: list[str], ghosts: list[str], live: bool = False
) -> rrb.Blueprint:
    """What the viewer shows of a run, with the recorded robots of these names.

    ghosts: those with a believed pose; live: as it comes.
    On the left the arena above sensors and behaviour, on the right views from above, errors and events.
    """
    flat = sim.grid.dim == 2
    lines = [f"/trails/{name}" for name in robots] + [f"/believed_trails/{name}" for name in ghosts]
    trails = _recent(lines)
    lx, ly = sim.grid.extent[:2]
    side = 0.03 * stage.length  # room for labels
    box = [[x, y, z] for x in (-side, lx + side) for y in (0.0, ly) for z in (0.0, stage.height)]
    legend = -0.15 * stage.length
    framed = np.array([*box, [0.2 * lx, legend, 0.0], [0.8 * lx, legend, 0.0]])
    world = ["/world/**", "/robots/**", "/trails/**"]
    if ghosts:
        world += ["/believed/**", "/believed_trails/**"]

    def arena(name: str, contents: list[str], aspect: float, elevation_deg: float) -> rrb.Spatial3DView:
        position, target, up = drawing.camera(framed, aspect, elevation_deg)
        return rrb.Spatial3DView(
            origin="/",
            name=name,
            contents=contents,
            overrides=trails,
            background=BACKGROUND,
            line_grid=rrb.LineGrid3D(visible=False),
            eye_controls=rrb.EyeControls3D(position=position, look_target=target, eye_up=up),
        )

    ground = [*world, "/gas/slice", "/wind", "/legend/gas/**"]
    plots = _plots(robots)
    wide = 0.5 if sim.maps and flat else 0.62 if not flat else 0.72
    tall = 1.0
    if plots:
        tall = float(np.clip(1.9 * wide * (ly - legend) / (lx + 2 * side), 0.35, 0.6)) if flat else 0.6
    aspect = _aspect(wide, tall)
    if flat:
        main = arena("Arena", ground, aspect, 90.0)
    else:
        main = arena("Arena", [*world, "/gas/**", "/wind", "/legend/gas/**"], aspect, 48.0)
    shares = [tall, 0.45 * (1 - tall), 0.55 * (1 - tall)][: 1 + len(plots)]
    left = rrb.Vertical(main, *plots, row_shares=shares)

    aspect = _aspect(1 - wide, 0.5, bars=2 if sim.maps else 1)
    above: list[Any] = [] if flat else [arena("From above", ground, aspect, 90.0)]
    aspect = _aspect((1 - wide) / 2, 0.5, bars=2)  # of a map beside the truth
    unnamed = [f"- /world/openings/{n}/name" for n in range(len(sim.scenario.openings))]
    for n, gas_map in enumerate(sim.scenario.maps):
        pictures = {}
        for what in ESTIMATES:
            seen = [*world, *unnamed, f"/maps/{n}/{what}", f"/legend/{what}/**"]
            pictures[what] = arena(what.capitalize(), seen, aspect, 90.0)
        truth = pictures.pop("truth")
        name = gas_map.kind.replace("_", " ").capitalize()
        above.append(rrb.Horizontal(rrb.Tabs(*pictures.values(), active_tab=0), rrb.Tabs(truth), name=name))
    right = _beside(sim, above, bool(robots), flat)
    total = sim.scenario.warm_up + sim.scenario.duration
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[wide, 1 - wide]),
        rrb.TopPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed",
            timeline=TIME,
            play_state="following" if live else "playing",
            playback_speed=float(np.clip(total / 60, 1, 20)),
        ),
        auto_views=False,
    )


def _beside(sim: Simulation, above: list[Any], robots: bool, flat: bool) -> rrb.Vertical:
    """What stands beside the arena: views from above and maps, the maps' scores, events and the text."""
    parts: list[Any] = []
    shares = []
    if above:
        first = 1 if sim.maps and not flat else 0
        parts.append(rrb.Tabs(*above, active_tab=first, name="Maps"))
        shares.append(0.5)
    if sim.maps:
        kinds = list(zip(MAP_SERIES, MAP_TITLES, strict=True))
        if not any(isinstance(gas_map, Uncertain) for gas_map in sim.maps):
            kinds.pop()
        scored = [_series(f"/{origin}", title, len(sim.maps) <= MOST_LANES) for origin, title in kinds]
        parts.append(rrb.Tabs(*scored, active_tab=0, name="Scores"))
        shares.append(0.2)
    columns = rrb.TextLogColumns(timeline_columns=[TIME], text_log_columns=["loglevel", "body"])
    events = rrb.TextLogView(origin="/events", name="Events", columns=columns)
    about = rrb.TextDocumentView(origin="/about", name="About")
    parts.append(rrb.Tabs(events, about, active_tab=0 if robots else 1))
    shares.append(0.3)
    return rrb.Vertical(*parts, row_shares=shares)


def _aspect(width: float, height: float, bars: int = 1) -> float:
    """Width over height of a view with these shares of a 1600 x 900 window, under `bars` title bars."""
    return 1600 * width / (830 * height - 28 * bars)


def _plots(robots: list[str]) -> list[Any]:
    if not robots:
        return []
    lanes = [f"/states/{name}" for name in robots[:MOST_LANES]]
    return [
        _series("/sensors", "Gas sensors [ppm]", len(robots) <= MOST_LANES),
        rrb.StateTimelineView(origin="/states", contents=lanes, name="Behaviour"),
    ]


def _series(origin: str, name: str, legend: bool) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=origin, name=name, plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=legend)
    )


def _recent(entities: list[str]) -> Any:
    edge = rrb.TimeRangeBoundary
    span = rrb.VisibleTimeRange(TIME, start=edge.cursor_relative(seconds=-TRAIL), end=edge.cursor_relative())
    return {entity: rrb.VisibleTimeRanges(span) for entity in entities}
