"""Pictures and wind arrows of a run in planes, from the recording or, without a recording, from the film."""

from collections.abc import Sequence
from functools import cached_property
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_plume.files.run_folder import RunFolderError

if TYPE_CHECKING:  # zarr and rerun, where they are needed
    from taichi_plume.files.film import Film
    from taichi_plume.record.reading import Arrows, Picture
    from taichi_plume.scenario.scenario import Scenario

ALL_TIMES = (-inf, inf)


class Planes:
    """The pictures of a run; every method may raise RunFolderError.

    names: of pictures, such as "gas_slice", None for all; between: first and last time [s]; spacing: least time from
    picture to picture [s].
    """

    def __init__(self, folder: Path, scenario: "Scenario"):
        self.scenario = scenario
        self.recording, self._fields = folder / "recording.rrd", folder / "fields.zarr"

    @property
    def has_recording(self) -> bool:
        """Whether there is a recording."""
        return self.recording.exists()

    @property
    def has_film(self) -> bool:
        """Whether there are recorded fields."""
        return self._fields.is_dir()

    @cached_property
    def film(self) -> "Film":
        """The recorded fields."""
        from taichi_plume.files.film import Film, FilmError

        try:
            return Film(self._fields)
        except FilmError as error:
            raise RunFolderError(str(error)) from None

    def read(
        self,
        names: Sequence[str] | None = None,
        between: tuple[float, float] = ALL_TIMES,
        spacing: float = 0.0,
    ) -> "dict[str, Picture]":
        """Return pictures by name; an empty dict without a recording and a film."""
        if self.has_recording:
            from taichi_plume.record import reading

            return reading.read(self.recording, names, between, spacing)
        if self.has_film:
            from taichi_plume.results.film_pictures import of_film

            return of_film(self.film, self.scenario, names, between, spacing)
        return {}

    def names(self) -> list[str]:
        """Return the names of the pictures."""
        if self.has_recording:
            from taichi_plume.record import reading

            return reading.names(self.recording)
        return list(self.read(None, (inf, inf)))

    def span(self, names: Sequence[str] | None = None) -> tuple[float, float] | None:
        """Return the first and last time [s] of pictures, if any."""
        if self.has_recording:
            from taichi_plume.record import reading

            return reading.span(self.recording, names)
        return (float(self.film.times[0]), float(self.film.times[-1])) if self.has_film else None

    def arrows(
        self, plane: str, between: tuple[float, float] = ALL_TIMES, spacing: float = 0.0
    ) -> "Arrows | None":
        """Return the wind in a plane, "slice" or "section"; None without a recording and a film."""
        if self.has_recording:
            from taichi_plume.record import reading

            return reading.arrows(self.recording, plane, between, spacing)
        if self.has_film:
            from taichi_plume.results.film_pictures import arrows_of_film

            return arrows_of_film(self.film, self.scenario, plane, between, spacing)
        return None
