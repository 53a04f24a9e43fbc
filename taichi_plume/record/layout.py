"""Layout of a recording in the viewer (rerun blueprint): views, cameras, panels."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import rerun.blueprint as rrb

from taichi_plume.files.run_tables import title_of
from taichi_plume.observed.planes import Plane
from taichi_plume.observed.quantities import ABOVE, Quantity
from taichi_plume.observed.scales import slices
from taichi_plume.record import drawing
from taichi_plume.record.drawing import TIME
from taichi_plume.record.legends import TICKS, TITLE
from taichi_plume.record.placement import Stage, placed
from taichi_plume.record.scene import beside
from taichi_plume.scoring.beliefs import believers
from taichi_plume.scoring.declarations import may_declare
from taichi_plume.time_loop import Mapper, TimeLoop, Uncertain

if TYPE_CHECKING:
    from taichi_plume.record.tracks import Robot

Part = rrb.View | rrb.Container
MOST_LANES = 12  # legible behaviour lanes and entries of a legend
MAP_SERIES = {
    "map_errors": "error_ppm",
    "map_correlations": "correlation",
    "map_peaks": "peak_distance_m",
    "map_surprises": "nlpd",
}
"""Entities and names of the scores of maps, the error first."""
MAP_NAMES = {
    "estimate": "Estimate [ppm]",
    "weight": "Weight",
    "error": "Ratio",
    "truth": "Truth: mean gas so far [ppm]",
}
"""Pictures of a map and their titles."""
WIND_MAP_NAMES = {"estimate": "Estimate [m/s]", "truth": "Truth: mean wind so far [m/s]"}
MAP_TITLES = (
    "Error against the mean gas [ppm]", "Correlation with the mean gas", "Peak to source [m]",
    "NLPD of the next readings",
)  # fmt: skip
BACKGROUND = (24, 26, 32)
TEXT_HEIGHT = 32  # pixels, of a label and the gap above


@dataclass(frozen=True)
class Shown:
    """Contents of a recording: robots, planes and quantities; live: followed by a viewer."""

    stage: Stage
    robots: Sequence["Robot"]
    seen: Sequence[Plane]
    quantities: Sequence[Quantity]
    live: bool = False


class Panel(NamedTuple):
    """Size of a view [pixels]."""

    width: float
    height: float

    @staticmethod
    def of(wide: float, tall: float, bars: int = 1) -> "Panel":
        """Return the panel with these fractions of a 1600 x 900 window, under `bars` title bars."""
        return Panel(1600 * wide, 830 * tall - 28 * bars)

    @property
    def titled(self) -> bool:
        """Whether there is room for the titles of legends, which repeat the names of views."""
        return self.height > 330


class Layout:
    """Builder of views. Left: the arena above sections, sensors and behaviour. Right: views from above and maps, above
    their scores and the events.
    """

    def __init__(self, sim: TimeLoop, shown: Shown):
        self.sim, self.shown, self.stage = sim, shown, shown.stage
        self.flat = sim.grid.dim == 2
        self.names = [robot.name for robot in shown.robots]
        ghosts = [robot.name for robot in shown.robots if robot.reckons]
        lines = [f"/trails/{name}" for name in self.names] + [f"/believed_trails/{name}" for name in ghosts]
        self.trails = _recent(lines, trail(sim, len(self.names)))
        self.robots = ["/robots/**", "/trails/**"]
        if any(may_declare(group) for group in sim.scenario.robots):
            self.robots.append("/declared/**")
        if ghosts:
            self.robots += ["/believed/**", "/believed_trails/**"]
        self.tops = [plane for plane in shown.seen if plane.letters == "xy"]
        self.sides = [plane for plane in shown.seen if plane.letters != "xy"]
        self.believers = [group for algorithm in believers(sim) for group in algorithm.members.groups]
        self.mapped = bool(sim.maps or self.believers)
        self.main = [quantity for quantity in shown.quantities if "/" not in quantity.entity]
        self.unnamed = [f"- /world/openings/{n}/name" for n in range(len(sim.scenario.openings))]

    def blueprint(self) -> rrb.Blueprint:
        """Return the layout."""
        left, wide = self._left()
        total = self.sim.scenario.warm_up + self.sim.scenario.duration
        return rrb.Blueprint(
            rrb.Horizontal(left, self._right(1 - wide), column_shares=[wide, 1 - wide]),
            rrb.TopPanel(state="collapsed"),
            rrb.BlueprintPanel(state="collapsed"),
            rrb.SelectionPanel(state="collapsed"),
            rrb.TimePanel(
                state="collapsed",
                timeline=TIME,
                play_state="following" if self.shown.live else "playing",
                playback_speed=float(np.clip(total / 60, 1, 20)),
            ),
            auto_views=False,
        )

    # ------------------------------------------------------------ spatial views

    def _view(
        self, name: str, contents: list[str], points: np.ndarray, panel: Panel, *angles: float
    ) -> rrb.Spatial3DView:
        """Return a view whose camera frames some points (n, 3) [m]; angles: see `drawing.camera`."""
        position, target, up = drawing.camera(points, panel.width / panel.height, *angles)
        return rrb.Spatial3DView(
            origin="/",
            name=name,
            contents=contents,
            overrides=self.trails,
            background=BACKGROUND,
            line_grid=rrb.LineGrid3D(visible=False),
            eye_controls=rrb.EyeControls3D(position=position, look_target=target, eye_up=up),
        )

    def _framed(self, u: float, v: float, panel: Panel) -> tuple[float, float, float]:
        """Return left, right and lower end [m] of a picture u x v with its legend, and room for the texts below."""
        side, length = 0.03 * self.stage.length, self.stage.length
        below = (TITLE if panel.titled else TICKS) * length
        room = min(TEXT_HEIGHT, 0.3 * panel.height)
        scale = max((v + below) / (panel.height - room), (u + 2 * side) / panel.width)  # m per pixel
        return -side, u + side, -below - room * scale

    def _floor(self, height: float, panel: Panel) -> np.ndarray:
        """Return the corners of the arena up to a height, and of its legend."""
        lx, ly = self.stage.extent[:2]
        left, right, below = self._framed(lx, ly, panel)
        box = [[x, y, z] for x in (left, right) for y in (0.0, ly) for z in (0.0, height)]
        return np.array([*box, [0.2 * lx, below, 0.0], [0.8 * lx, below, 0.0]])

    def _pictures(self, quantity: Quantity, plane: Plane, panel: Panel) -> list[str]:
        """Return the entities of a picture with its legend and the wind."""
        entity = f"{quantity.entity}/{plane.name}"
        wind = "slice" if plane.over_height else plane.name
        seen = [f"/{entity}", f"/legend/{entity}/**", f"/wind/{wind}", f"/legend/wind/{wind}/**"]
        return seen if panel.titled else [*seen, f"- /legend/{entity}/title"]

    def _above(self, quantity: Quantity, plane: Plane, name: str, panel: Panel) -> Part:
        """Return a view of the arena from above, with the picture of a quantity on a horizontal plane."""
        unnamed = [] if self.flat else self.unnamed  # no room for names
        contents = ["/world/**", "- /world/walls", *unnamed, *self.robots]
        contents += self._pictures(quantity, plane, panel)
        return self._view(name, contents, self._floor(0.0, panel), panel, 90.0)

    def _side(self, quantity: Quantity, plane: Plane, name: str, panel: Panel) -> Part:
        """Return a side view of a vertical section with the picture of a quantity."""
        u, v = (self.stage.extent[d] for d in plane.axes)
        left, right, below = self._framed(u, v, panel)
        corners = [[left, -0.01 * v], [right, 1.02 * v], [0.2 * u, below], [0.8 * u, below]]
        contents = [f"/outlines/{plane.name}/**", *(f"/world/{entity}" for entity in beside(self.sim, plane))]
        contents += self._pictures(quantity, plane, panel)
        azimuth = 0.0 if plane.normal == 1 else 90.0
        return self._view(name, contents, placed(plane, corners, self.stage), panel, 0.0, azimuth)

    # ------------------------------------------------------------ columns

    def _left(self) -> tuple[Part, float]:
        """Return the viewer's left column (arena, sections, sensors), and the column's fraction of the width."""
        plots = _plots(self.names, self.sim)
        lx, ly = self.stage.extent[:2]
        if self.flat:
            wide, tall = (0.5 if self.mapped else 0.72), 1.0
            if plots:
                tall = float(np.clip(1.9 * wide * (ly + 0.15 * self.stage.length) / lx, 0.35, 0.6))
            main, shares = [self._flat_arena(Panel.of(wide, tall, bars=min(2, len(self.main))))], [tall]
        else:
            wide, whole = 0.6, 0.61 if plots else 1.0
            share = 0.0
            if self.sides and self.main:
                u, v = (self.stage.extent[d] for d in self.sides[0].axes)
                share = whole * float(np.clip(0.2 + 0.4 * v / u, 0.28, 0.45))
            main, shares = [self._arena(Panel.of(wide, whole - share))], [whole - share]
            if share:
                main.append(self._sections(wide, share))
                shares.append(share)
        if plots:  # side by side: a lane takes some 36 pixels of the height
            main.append(rrb.Horizontal(*plots))
            shares.append(1 - sum(shares))
        return rrb.Vertical(*main, row_shares=shares), wide

    def _flat_arena(self, panel: Panel) -> Part:
        """Return the arena of a 2-D run: a tab for each quantity."""
        views = []
        for quantity in self.shown.quantities:
            name = "Arena" if quantity.entity == "gas" else quantity.heading
            views.append(self._above(quantity, self.tops[0], name, panel))
        if not views:
            world = ["/world/**", *self.robots, "/wind/slice", "/legend/wind/**"]
            return self._view("Arena", world, self._floor(0.0, panel), panel, 90.0)
        return _tabs(views)

    def _arena(self, panel: Panel) -> Part:
        """Return the arena in 3-D; on its floor the maximum of the gas over the height."""
        contents = ["/world/**", *self.robots]
        for quantity in self.main[:1]:
            columns = [plane for plane in self.tops if quantity.on(plane) and plane.over_height]
            floor = [*columns, self.tops[0]][0]
            contents += [*self._pictures(quantity, floor, panel), "/gas/volume"]
        return self._view("Arena", contents, self._floor(self.stage.height, panel), panel, 48.0)

    def _sections(self, wide: float, tall: float) -> Part:
        """Return gas and temperature side by side, with a tab for every section: of temperature the last one first."""
        groups = []
        for quantity in self.main:
            planes = self.sides if quantity.unit == "ppm" else self.sides[::-1]
            panel = Panel.of(wide / len(self.main), tall)
            names = [_name(quantity, plane, n) for n, plane in enumerate(planes)]
            sections = zip(planes, names, strict=True)
            groups.append(_tabs([self._side(quantity, plane, name, panel) for plane, name in sections]))
        return groups[0] if len(groups) == 1 else rrb.Horizontal(*groups)

    def _right(self, wide: float) -> rrb.Vertical:
        parts: list[Part] = []
        shares: list[float] = []
        if not self.flat:
            groups = self._groups()
            tall = 0.4 if not self.mapped else 0.34 / max(1, len(groups))
            for group in groups:
                panel, views = Panel.of(wide, tall), []
                for n, (quantity, plane) in enumerate(group):
                    views.append(self._above(quantity, plane, _name(quantity, plane, n), panel))
                parts.append(rrb.Tabs(*views, active_tab=0, name="From above"))
                shares.append(tall)
        if self.mapped:
            tall = 0.5 if self.flat else 0.3
            maps = [*self._maps(wide, tall), *self._beliefs(wide, tall)]
            parts.append(rrb.Tabs(*maps, active_tab=0, name="Maps"))
            shares.append(tall)
        if self.sim.maps:
            kinds = list(zip(MAP_SERIES, MAP_TITLES, strict=True))
            if not any(isinstance(gas_map, Uncertain) for gas_map in self.sim.maps):
                kinds.pop()
            is_short = len(self.sim.maps) <= MOST_LANES
            measured = {gas_map.measures for gas_map in self.sim.scenario.maps}
            kinds = kinds if "gas" in measured else []
            kinds += [("wind_map_errors", "Error against the mean wind [m/s]")] if "wind" in measured else []
            scored = [_series(f"/{origin}", title, is_short) for origin, title in kinds]
            parts.append(rrb.Tabs(*scored, active_tab=0, name="Scores"))
            shares.append(0.18)
        columns = rrb.TextLogColumns(timeline_columns=[TIME], text_log_columns=["loglevel", "body"])
        events = rrb.TextLogView(origin="/events", name="Events", columns=columns)
        described = rrb.TextDocumentView(origin="/about", name="About: legend and key facts")
        parts.append(rrb.Tabs(events, described, active_tab=0 if self.names else 1))
        shares.append(max(0.18, 1 - sum(shares)))
        return rrb.Vertical(*parts, row_shares=shares)

    def _groups(self) -> list[list[tuple[Quantity, Plane]]]:
        """Return the pictures from above that share a panel: of the gas, the maximum over the height first, and of
        temperature, the last slice first.
        """
        groups = []
        for unit in ("ppm", "K"):
            planes = sorted(self.tops, key=lambda plane: not plane.over_height)
            planes = planes if unit == "ppm" else planes[::-1]
            quantities = [quantity for quantity in self.shown.quantities if quantity.unit == unit]
            groups.append(
                [(quantity, plane) for quantity in quantities for plane in planes if quantity.on(plane)]
            )
        return [group for group in groups if group]

    def _maps(self, wide: float, tall: float) -> list[Part]:
        """Return a panel of the viewer for each map, with the truth beside it."""
        panel = Panel.of(wide / 2, tall, bars=2)
        species = " + ".join(gas.name for gas in self.sim.gas.species)
        maps = []
        for n, gas_map in enumerate(self.sim.scenario.maps):
            is_wind, kind = gas_map.measures == "wind", gas_map.kind.replace("_", " ")
            name = kind if is_wind else f"{species.capitalize()} map: {kind}"
            parts = []
            for entity, layer, height in map_parts(n, self.sim.maps[n]):
                pictures = {}
                for what, title in (WIND_MAP_NAMES if is_wind else MAP_NAMES).items():
                    legend = "wind/map" if is_wind else what
                    pictures[what] = self._map(title, f"/{entity}/{what}", legend, panel)
                truth = pictures.pop("truth")
                part = name if layer is None else height
                views = rrb.Tabs(*pictures.values(), active_tab=0), rrb.Tabs(truth)
                parts.append(rrb.Horizontal(*views, name=part))
            maps.append(rrb.Tabs(*parts, active_tab=0, name=name) if len(parts) > 1 else parts[0])
        return maps

    def _beliefs(self, wide: float, tall: float) -> list[Part]:
        """Return the belief map of the first robot of each group with beliefs."""
        panel = Panel.of(wide, tall)
        return [
            self._map(f"Belief of {group.name} [1/m²]", f"/beliefs/{group.number}", "belief", panel)
            for group in self.believers
        ]

    def _map(self, name: str, entity: str, legend: str, panel: Panel) -> Part:
        """Return a view of a picture of a map with its legend, without names of openings."""
        contents = ["/world/**", "- /world/walls", *self.unnamed, *self.robots]
        contents += [entity, f"/legend/{legend}/**", f"- /legend/{legend}/title"]
        return self._view(name, contents, self._floor(0.0, panel), panel, 90.0)


def map_parts(n: int, gas_map: Mapper) -> list[tuple[str, int | None, str]]:
    """Return the shown parts of map n: path of the pictures, layer and text of the height, of a map without layers None
    and "".
    """
    if gas_map.levels is None:
        return [(f"maps/{n}", None, "")]
    middle = gas_map.levels.middle
    return [(f"maps/{n}/{k}", k, f"z = {middle[k]:.3g} m") for k in slices(len(middle))]


def trail(sim: TimeLoop, robots: int) -> float | None:
    """Return the time span [s] of a robot's past path that the viewer shows; None for the whole path."""
    if sim.scenario.recording.trail is not None:
        return sim.scenario.recording.trail
    if robots <= 2:
        return None
    groups = sim.scenario.robots
    speeds = [vars(group.algorithm).get("speed") or group.body.max_speed for group in groups]
    return max(20.0, 2 * max(sim.grid.extent[:2]) / min(speeds))


def _name(quantity: Quantity, plane: Plane, n: int) -> str:
    """Return the name of view n of a group; the first name has the quantity."""
    return f"{quantity.heading}, {plane.text}" if n == 0 else plane.text


def _tabs(views: Sequence[Part]) -> Part:
    """Return a container with a tab for each view of the viewer; a single view is returned as is."""
    return views[0] if len(views) == 1 else rrb.Tabs(*views, active_tab=0)


def _plots(robots: list[str], sim: TimeLoop) -> list[Part]:
    """Return plots of the robots: readings, with decision quantities on tabs behind, and behaviour."""
    if not robots:
        return []
    legend = len(robots) <= MOST_LANES
    decided = [
        _series(f"/decisions/{each.name}", title_of(each.name, each.unit), legend)
        for each in sim.decision_columns()
    ]
    sensors = f"Gas sensors{ABOVE if sim.gas.has_background else ''} [ppm]"
    lanes = [f"/states/{name}" for name in robots[:MOST_LANES]]
    return [
        _tabs([_series("/sensors", sensors, legend), *decided]),
        rrb.StateTimelineView(origin="/states", contents=lanes, name="Behaviour"),
    ]


def _series(origin: str, name: str, legend: bool) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=origin, name=name, plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=legend)
    )


def _recent(entities: list[str], seconds: float | None) -> Any:
    """Return visible time ranges of entities: the last seconds, or the whole run."""
    edge = rrb.TimeRangeBoundary
    start = edge.infinite() if seconds is None else edge.cursor_relative(seconds=-seconds)
    span = rrb.VisibleTimeRange(TIME, start=start, end=edge.cursor_relative())
    return {entity: rrb.VisibleTimeRanges(span) for entity in entities}
