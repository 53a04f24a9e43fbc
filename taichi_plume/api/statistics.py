"""Statistics of a plume: ``tp.statistics(run)`` is ``taichi-plume statistics RUN``."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

if TYPE_CHECKING:
    from taichi_plume.fluctuations.result import Statistics
    from taichi_plume.results.run import Run
    from taichi_plume.scenario.sensors import GasSensor


def statistics(
    source: "Run | str | Path",
    *,
    gas: str | None = None,
    probe: str | None = None,
    threshold: Annotated[float | str | None, "PPM"] = None,
    start: Annotated[float | str | None, "--from T"] = None,
    bounds: Annotated[Sequence[float | str] | None, "--range A B"] = None,
    sensors: Annotated["Sequence[str | Mapping[str, object] | GasSensor]", "--sensor YAML ..."] = (),
    out: str | Path | None = None,
    page: bool = True,
) -> "Statistics":
    """Compute statistics of a plume: mean and rms, intermittency, whiffs and blanks, spectra, and what sensors detect.

    source: the folder of a run with `probes`, `fields` or pictures, or a film; in Python also a run. gas: species, by
    default the first. probe: only this probe. threshold: concentration above which there is gas [ppm], by default a
    tenth of the mean at the point with the most gas. start: leave out samples before this simulated time [s]. bounds:
    durations between which the power laws are fitted [s], by default chosen from the data. sensors: another gas sensor,
    such as {kind: pid, rise_time: 20 ms}; may be repeated.

    out: folder of the files, in Python by default none, of the command RUN/statistics, or FILM with -statistics instead
    of .zarr. page: write statistics.html.

    Raises InputError, whose lines name the options of the command, and OSError.

    >>> import taichi_plume as tp
    >>> probes = {"points": [{"kind": "point", "name": "axis", "at": [2, 1.5]}]}
    >>> run = tp.simulate("plumesim_casting", overrides={"probes": probes}, duration=10, out=folder)
    >>> plume = tp.statistics(run, threshold="5 ppm")
    >>> plume.samples, plume.points.attrs["units"]["rms"]
    (101, 'ppm')
    """
    from pydantic import Field

    from taichi_plume.fluctuations.computation import statistics_of
    from taichi_plume.guard.input_error import InputError
    from taichi_plume.guard.safe_open import as_path
    from taichi_plume.results.run import Run
    from taichi_plume.scenario import si
    from taichi_plume.scenario.changes import shown
    from taichi_plume.scenario.loading import load_part
    from taichi_plume.scenario.sensors import IdealGasSensor, MoxSensor, PidSensor

    sensor_kind = Annotated[MoxSensor | PidSensor | IdealGasSensor, Field(discriminator="kind")]
    ppm = load_part(threshold, "--threshold", si.SomePpm | None)
    begin = load_part(start, "--from", si.Time | None)
    within = load_part(bounds, "--range", tuple[si.Duration, si.Duration] | None)
    if within is not None and not within[0] < within[1]:
        raise InputError(
            f"--range: got {within[0]:g} and {within[1]:g} s; the first must be less than the second"
        )
    models = [load_part(sensor, "--sensor", sensor_kind) for sensor in sensors]
    if isinstance(source, Run):
        source = source.folder
    elif not isinstance(source, str | Path):
        raise InputError(f"source: got {shown(source)}; give a run, the folder of a run, or a film")
    plume = statistics_of(Path(source), gas, probe, ppm, begin, within, models)
    if out is not None:
        plume.write(as_path(out, "out"), page)
    return plume
