"""Statistics of a plume: ``tp.statistics(run)`` is ``python -m taichi_plume.statistics RUN``."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

from pydantic import Field

from taichi_plume.fluctuations.computation import statistics_of
from taichi_plume.fluctuations.result import Statistics
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.safe_open import as_path
from taichi_plume.quantities import Number
from taichi_plume.results.run import Run
from taichi_plume.scenario import si
from taichi_plume.scenario.changes import shown
from taichi_plume.scenario.loading import load_part
from taichi_plume.scenario.sensors import GasSensor, IdealGasSensor, MoxSensor, PidSensor

SENSOR = Annotated[MoxSensor | PidSensor | IdealGasSensor, Field(discriminator="kind")]


def statistics(
    source: Run | str | Path,
    *,
    gas: str | None = None,
    probe: str | None = None,
    threshold: Number | None = None,
    start: Number | None = None,
    bounds: Sequence[Number] | None = None,
    sensors: Sequence[str | Mapping[str, object] | GasSensor] = (),
    out: str | Path | None = None,
    page: bool = True,
) -> Statistics:
    """Compute statistics of a plume: mean and rms, intermittency, whiffs and blanks, spectra, and what sensors detect.

    source: a run with `probes`, `fields` or pictures, its folder, or a film. gas: species, by default the first. probe: name of
    the only probe to use. threshold: concentration above which there is gas [ppm], by default a tenth of the mean at
    the point with the most gas. start: samples before this simulated time are left out [s]. bounds: durations between
    which the power laws are fitted [s]. sensors: further gas sensors, as in a scenario:
    ``{"kind": "pid", "rise_time": "20 ms"}``.

    out: folder for the files of ``python -m taichi_plume.statistics``; by default nothing is written. page: whether
    statistics.html is among them. Raises InputError, whose lines name the options of the command, and OSError.

    >>> import taichi_plume as tp
    >>> probes = {"points": [{"kind": "point", "name": "axis", "at": [2, 1.5]}]}
    >>> run = tp.simulate("plumesim_casting", overrides={"probes": probes}, duration=10, out=folder)
    >>> plume = tp.statistics(run, threshold="5 ppm")
    >>> plume.samples, plume.points.attrs["units"]["rms"]
    (101, 'ppm')
    """
    ppm = load_part(threshold, "--threshold", si.SomePpm | None)
    begin = load_part(start, "--from", si.Time | None)
    within = load_part(bounds, "--range", tuple[si.Duration, si.Duration] | None)
    if within is not None and not within[0] < within[1]:
        raise InputError(
            f"--range: got {within[0]:g} and {within[1]:g} s; the first must be less than the second"
        )
    models = [load_part(sensor, "--sensor", SENSOR) for sensor in sensors]
    if isinstance(source, Run):
        source = source.folder
    elif not isinstance(source, str | Path):
        raise InputError(f"source: got {shown(source)}; give a run, the folder of a run, or a film")
    plume = statistics_of(Path(source), gas, probe, ppm, begin, within, models)
    if out is not None:
        plume.write(as_path(out, "out"), page)
    return plume
