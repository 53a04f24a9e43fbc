"""Pictures and films of a run, for talks, papers and notebooks: the recorded gas with its scale, wind and robots.

The data come from pictures.zarr or, without it, from fields.zarr; nothing is computed again.
"""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from taichi_plume.guard.input_error import InputError
from taichi_plume.report.films import film
from taichi_plume.report.html import data_url
from taichi_plume.report.plume import Arrows, PlumeView, Present, Scene, figure_of, view_in
from taichi_plume.report.theme import ANYWHERE, Place, figure_around, styled
from taichi_plume.report.theme import LETTERS as SIZES
from taichi_plume.results.pictures import picture_names, pictures, require_pictures, span, wind
from taichi_plume.results.run import Run
from taichi_plume.results.tracks import Track

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

VIEWS = {"above": "slice", "slice": "slice", "column": "column", "section": "section", "side": "section"}
"""Views, and the names of their planes."""
DPI = 160
LETTERS = 1.35  # over those of a page
PICTURE_WIDTH, FILM_WIDTH = 1600, 960  # pixels
MOST_FRAMES = 150  # of a film, unless asked for more
FPS = 12  # frames per second


class Shown(NamedTuple):
    """Contents of a picture: view, quantity such as "gas" or "temperature", width [pixels], arrows of the wind.

    view: see VIEWS, or a plane of the recording such as "section_2"; None: column in 3-D, else above.
    """

    view: str | None = None
    of: str = "gas"
    width: int | None = None
    wind: bool = True


DEFAULT = Shown()


class Film(NamedTuple):
    """Film of a run in memory, which a notebook shows. data: content of the file; format: "gif" or "mp4"."""

    data: bytes
    format: str
    times: np.ndarray
    """Simulated times of the frames [s]."""

    @classmethod
    def of(
        cls, run: Run, path: Path | None, shown: Shown, begin: float | None, end: float | None, fps: int
    ) -> "Film":
        """Return a film of the run, see `make_film`; path: file to write it to, or None."""
        with TemporaryDirectory() as folder:
            file = path or Path(folder) / "film.gif"
            times = make_film(run, file, shown, begin, end, None, fps)
            return cls(file.read_bytes(), file.suffix[1:].lower(), times)

    def _repr_html_(self) -> str:
        if self.format == "gif":
            return f'<img style="max-width:100%" src="{data_url(self.data, "image/gif")}">'
        return (
            f'<video controls loop style="max-width:100%" src="{data_url(self.data, "video/mp4")}"></video>'
        )

    def __repr__(self) -> str:
        if not len(self.times):
            return "Film without frames"
        return f"Film of {len(self.times)} frames, t = {self.times[0]:g} to {self.times[-1]:g} s"


def still(
    run: Run, at: float | None = None, shown: Shown = DEFAULT, place: Place = ANYWHERE
) -> tuple[Figure, "DataArray", float]:
    """Return a figure of the run at time `at` [s], by default the end, the recorded pictures drawn, and that time.

    place: axes to draw into, or size of the figure. Raises InputError if there is no such view or time.
    """
    period, end = max(1.0 / _rate(run, "rate"), run.scenario.tick), _end(run)
    at = end if at is None else at
    picture = _picture(run, shown, (at - 1.5 * period, at))
    if not picture.time.size or at > end + period:
        raise _outside(run, at)
    figure, view = framed(run, picture, run.tracks, shown.width or PICTURE_WIDTH, shown.wind, place)
    air = wind(run, _plane(picture), (at - 1.5 / _rate(run, "wind_rate"), at))
    show_at(view, picture[-1], at, Arrows.of(air))
    return figure, picture, at


def present(
    scene: Present, data: "Dataset", shown: Shown, tracks: Sequence[Track], place: Place = ANYWHERE
) -> Figure:
    """Return a figure of a running simulation, from a dataset of its views at the present time.

    Raises InputError if there is no such view or quantity.
    """
    names = [str(name) for name, values in data.data_vars.items() if "colors" in values.attrs]
    known = dict.fromkeys(name.rpartition(f"_{data[name].view}")[0] for name in names)
    if shown.of not in known:
        raise InputError(
            f"of: got {shown.of!r}; allowed are {', '.join(known) or 'none: nothing is computed'}"
        )
    allowed = [data[name].view for name in names if name == f"{shown.of}_{data[name].view}"]
    view = VIEWS.get(shown.view, shown.view) if shown.view else "column" if "column" in allowed else "slice"
    if view not in allowed:
        raise InputError(f"view: got {shown.view!r}; allowed are {', '.join(allowed)}")
    picture = data[f"{shown.of}_{view}"]
    drawn, frame = framed(scene, picture, tracks, shown.width or PICTURE_WIDTH // 2, shown.wind, place)
    plane = f"_{_plane(picture)}"
    air = data[[name for name in map(str, data.data_vars) if name[:1] in "uvw" and name[1:] == plane]]
    with styled():
        show_at(frame, picture, float(data.time), Arrows.of(air) if shown.wind else None)
    return drawn


def make_film(
    run: Run,
    path: Path,
    shown: Shown = DEFAULT,
    begin: float | None = None,
    end: float | None = None,
    frames: int | None = None,
    fps: int = FPS,
) -> np.ndarray:
    """Write a film of the run from `begin` to `end` [s], .gif or .mp4; return the times of its frames [s].

    By default from the start of the robots to the end, with at most MOST_FRAMES frames. Raises InputError, OSError.
    """
    begin = max(run.begin, 0.0) if begin is None else begin
    end = _end(run) if end is None else end
    if not begin < end:
        what = f"a film from {begin:g} to {end:g} s is empty; choose another --begin and --end"
        raise InputError(f"{run.folder}: {what}")
    count = frames or MOST_FRAMES
    picture = _picture(run, shown, (begin, end), 0.0 if frames else (end - begin) / count)
    if not picture.time.size:
        raise _outside(run, begin)
    chosen = list(range(picture.time.size))
    if len(chosen) > count:
        chosen = np.linspace(0, len(chosen) - 1, count).round().astype(int).tolist()
    figure, view = framed(run, picture, run.tracks, shown.width or FILM_WIDTH, shown.wind)
    between = (begin - 1.5 / _rate(run, "wind_rate"), end)
    arrows = Arrows.of(wind(run, _plane(picture), between, (end - begin) / count))

    def show(n: int) -> None:
        show_at(view, picture[n], float(picture.time[n]), arrows)

    with styled():
        film(figure, view.moving, path, fps, chosen, show)
    return picture.time.values[chosen]


def show_at(view: PlumeView, picture: "DataArray", t: float, arrows: Arrows | None) -> None:
    """Update a view to time t [s], with a picture of that time."""
    view.show(t, picture.values, arrows)
    view.clock.set_text(f"t = {t:.1f} s")


def framed(
    scene: Scene,
    picture: "DataArray",
    tracks: Sequence[Track],
    width: int,
    wind: bool,
    place: Place = ANYWHERE,
) -> tuple[Figure, PlumeView]:
    """Return a figure, `width` pixels wide unless `place` is given, and the view that draws the plume in the figure."""
    if place.ax is not None:
        return figure_around(place.ax), view_in(place.ax, scene, picture, tracks, wind)
    if place.figsize is not None:
        with styled():
            return figure_of(
                scene, picture, tracks, place.figsize[0], DPI, wind=wind, height=place.figsize[1]
            )
    dpi = DPI * width / PICTURE_WIDTH
    larger = {key: LETTERS * size for key, size in SIZES.items()}
    with styled(larger | {"xtick.labelsize": 11, "ytick.labelsize": 11}):
        return figure_of(scene, picture, tracks, PICTURE_WIDTH / DPI, dpi, LETTERS, wind)


# ---------------------------------------------------------------- recorded pictures


def _picture(run: Run, shown: Shown, between: tuple[float, float], spacing: float = 0.0) -> "DataArray":
    """Read the recorded gas pictures of one view between two times [s]. Raises InputError if the run has none."""
    views = [VIEWS.get(shown.view, shown.view)] if shown.view else ["column", "slice"]
    require_pictures(run)
    there = picture_names(run)
    names = [f"{shown.of}_{view}" for view in views]
    name = next((name for name in names if name in there), None)
    if name is None:
        what = f"has no pictures of {' or '.join(names)}, but of {', '.join(there) or 'none'}"
        raise InputError(f"{run.folder}: {what}")
    return pictures(run, [name], between, spacing)[name]


def _rate(run: Run, key: str) -> float:
    """Return the number of recorded pictures per simulated second; key: `rate` for gas, `wind_rate` for wind."""
    fields = run.scenario.fields
    if fields is None or run.has("pictures.zarr"):
        return vars(run.scenario.recording)[key]
    return fields.rate


def _plane(picture: "DataArray") -> str:
    """Return the name of the plane whose recorded wind is drawn into a picture of gas."""
    return picture.view if picture.axes != "xy" else "slice"


def _end(run: Run) -> float:
    """Return the simulated end time of a run [s]; of an unfinished run, the last recorded time."""
    simulated = run.result.get("simulated_s")
    if isinstance(simulated, int | float) and not run.unfinished:
        return run.begin + float(simulated)
    return max([*(float(track.t[-1]) for track in run.tracks), *(span(run) or ())], default=run.begin)


def _outside(run: Run, at: float) -> InputError:
    times = span(run)
    there = "none" if times is None else f"from {times[0]:g} to {times[1]:g} s"
    return InputError(f"{run.folder}: t = {at:g} s is outside the run, whose pictures are {there}")
