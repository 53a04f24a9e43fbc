"""Pictures and films of a run, for talks and papers: ``tp.picture(folder, at=20)`` is ``taichi-plume picture``.

A picture shows the recorded gas with its scale over the scene, and the wind and the robots of that moment. The data
come from pictures.zarr or, without it, from fields.zarr; nothing is computed again.
"""

from pathlib import Path
from typing import Annotated

Time = Annotated[float | str | None, "S"]
SUFFIXES = (".png", ".pdf", ".svg", ".jpg")
FILMS = (".gif", ".mp4")
LIMITS = {"frames": (1, 10_000), "fps": (1, 50), "width": (200, 8000)}


def picture(
    run: str | Path,
    *,
    at: Time = None,
    out: Annotated[str | Path | None, "FILE"] = None,
    film: Annotated[str | Path | None, "FILE"] = None,
    view: str | None = None,
    of: Annotated[str, "QUANTITY"] = "gas",
    begin: Time = None,
    end: Time = None,
    frames: Annotated[int | None, "N"] = None,
    fps: Annotated[int, "N"] = 12,
    width: Annotated[int | None, "PIXELS"] = None,
    wind: bool = True,
    allow_outside: bool = False,
) -> dict[Path, str]:
    """Draw a moment of a run, or a film of it, for a talk or a paper. Return what each file shows.

    run: the run's folder. at: simulated time in seconds, by default the end. out: .png, .pdf, .svg or .jpg, by default
    RUN-VIEW-AT.png in the working folder. film: make a film: .gif, or .mp4 with ffmpeg. view: above: at the height of
    the slice; column: maximum over the height, from above; section or side: the vertical plane through the source; or
    another plane of the recording, such as section_2; by default column in 3-D, else above. of: gas, temperature, ...

    begin: first time of a film, by default the start of the robots. end: last time of a film, by default the end.
    frames: number in a film, by default at most 150. fps: frames per second of a film. width: pixels, by default 1600,
    of a film 960. wind: draw the arrows of the wind. allow_outside: read maps and meshes outside the run's folder that
    are not those of the run.

    Raises InputError and OSError.
    """
    from pydantic import Field

    from taichi_plume.files.disk import written_whole
    from taichi_plume.guard.input_error import InputError
    from taichi_plume.guard.safe_open import as_path
    from taichi_plume.guard.terminal import say
    from taichi_plume.report.pictures import VIEWS, Shown, make_film, still
    from taichi_plume.results.run import Run
    from taichi_plume.scenario import si
    from taichi_plume.scenario.loading import load_part

    for name, number in (("frames", frames), ("fps", fps), ("width", width)):
        least, most = LIMITS[name]
        load_part(number, f"--{name}", Annotated[int | None, Field(ge=least, le=most, strict=True)])
    times = [
        load_part(time, f"--{name}", si.Time | None)
        for name, time in (("at", at), ("begin", begin), ("end", end))
    ]
    for name, file, suffixes in (("out", out, SUFFIXES), ("film", film, FILMS)):
        if file is not None and as_path(file, f"--{name}").suffix.lower() not in suffixes:
            raise InputError(f"--{name}: {file} must end in {', '.join(suffixes)}")
    opened = Run(as_path(run, "run"), lenient=True, allow_outside=allow_outside)
    for lack in opened.lacks:
        say(f"note: {lack}", error=True)
    shown, drawn = Shown(view, of, width, wind), {}
    if film is not None:
        of_frames = make_film(opened, Path(film), shown, times[1], times[2], frames, fps)
        span = f"t = {of_frames[0]:.4g} to {of_frames[-1]:.4g} s"
        drawn[Path(film)] = f"{len(of_frames)} frames, {span}"
    if film is None or at is not None or out is not None:
        figure, plane, moment = still(opened, times[0], shown)
        name = next((name for name, view in VIEWS.items() if plane.view == view), plane.view)
        path = Path(out or f"{opened.folder.resolve().name}-{name}-{moment:g}s.png")
        with written_whole(path) as fresh:
            figure.savefig(fresh, format=path.suffix[1:].lower())
        drawn[path] = f"{plane.name.replace('_', ' ')} at t = {plane.time.values[-1]:.4g} s"
    return drawn
