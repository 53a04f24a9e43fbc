"""Plumes of the programs PlumeSim and Fluent in a scenario: concentrations in percent of a full scale."""

import re
from collections.abc import Iterator
from math import prod
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, field_validator

from taichi_plume.quantities import fault
from taichi_plume.scenario import si
from taichi_plume.scenario.domain import Context, Domain
from taichi_plume.scenario.playback import PlumeSimLog, PointPlayback
from taichi_plume.scenario.sources import OneGas, Target
from taichi_plume.scenario.vocabulary import FileName, consistency_check

MOST_NODES = 1_000_000  # of a lattice on the domain


class PercentGas(OneGas):
    """A plume in percent of a full scale, as in PlumeSim; in 3-D the same at every height."""

    full_scale_ppm: si.FullScale = 100.0
    """Concentration in ppm of 100 percent."""
    sources: tuple[Target, ...] = ()
    """Places that robots search for; they emit nothing, the plume is given."""

    @property
    def finest(self) -> float | None:
        """Distance [m] of sample points for line integrals through this gas: an eighth of its cell or radius."""
        width = vars(self).get("cell") or vars(self).get("radius")
        return width / 8.0 if width else None


class PlumeSimGas(PercentGas, PlumeSimLog):
    """The plume of a log of PlumeSim."""

    kind: Literal["plumesim_log"]


class FluentGas(PercentGas, PointPlayback):
    """A plume computed by Fluent, exported as text, one file per frame; see point_frames.py."""

    key: ClassVar[str] = "files"
    kind: Literal["fluent"]
    files: FileName
    """Path of the files, relative to the scenario's folder. Such as plume%03d.txt for plume001.txt, plume002.txt and
    so on."""
    frames: si.Count | None = None
    """Number of files to take; unless given, all there are."""
    period: si.Duration = 1.0
    """Time from one file to the next."""
    cell: si.Length = 0.1
    """Distance up to which a point counts."""
    columns: dict[Literal["x", "y", "chemical"], str] = Field(default_factory=dict)
    """Names of the columns for x, y and chemical, the gas. Unless given, x and y have names of Fluent, and the gas is
    the only other column. Without such names the order is index, x, y, chemical."""
    largest: si.Magnitude | None = None
    """Concentration that counts as 100 percent, in the files' unit; unless given, the largest in them."""

    @field_validator("files")
    @classmethod
    def _numbered(cls, files: str) -> str:
        if not re.fullmatch(r"[^%]*%(0?[1-9])?d[^%]*", Path(files).name):
            raise fault("must hold one number, such as plume%03d.txt, in the file's name")
        return files


class PlumeSimPuff(PercentGas):
    """PlumeSim's Gaussian plume: a puff that spreads, frame by frame.

    It is defined on nodes to the right of and above its release:
    Percent = amount/(4 pi sqrt(Dx Dy) n) exp(-(dx²/Dx + dy²/Dy)/(4 n)) with the number n of the frame: 1, 2, ... last,
    then again from `repeat_from`. A reading is the value of the nearest node that is closer than the cell, else zero.
    PlumeSim combines it with a wind of 0.5 m/s along x.
    """

    kind: Literal["plumesim_gaussian"]
    release_point: si.Point2
    """Where the puff is released, x and y."""
    diffusion: tuple[si.SomeCoefficient, si.SomeCoefficient] = (0.2, 0.005)
    """Spread per frame along x and y, Dx and Dy, in m² per frame."""
    amount: si.SomeCoefficient = 100.0
    """Released amount, in percent times m². Concentrations are proportional to it."""
    cell: si.Length = 0.1
    """Distance of the nodes; a reading is the value of the nearest one."""
    all_around: bool = False
    """Put nodes to the left of and below the release too, unlike PlumeSim."""
    period: si.Duration = 1.0
    """Time from one frame to the next."""
    last: si.Count = 25
    """Number of the last frame; then frames start again from `repeat_from`."""
    repeat_from: si.Count = 20
    """Number of the frame that follows the last one."""
    start: si.Time = 0.0
    """Time since the release when the robots start."""

    @consistency_check
    def _returns(self) -> Iterator[str]:
        if self.repeat_from > self.last:
            yield "repeat_from must not be above last"

    def errors(self, where: str, context: Context) -> Iterator[str]:
        yield from _release(where, self.release_point, context)
        yield from nodes(where, self.cell, context.domain)


class PlumeSimMeander(PercentGas):
    """PlumeSim's meandering plume: random points about a random line along x, drawn once per run.

    A reading is the number of points within the radius, as a share of that one radius downwind of the release, 100
    percent at most. PlumeSim combines it with a wind of 0.5 m/s along x.
    """

    kind: Literal["plumesim_meandering"]
    release_point: si.Point2
    """Where the plume starts, x and y."""
    points: Annotated[int, Field(ge=20, le=1_000_000)] = 200
    """Approximate number of points. More make a smoother plume."""
    release_rate: si.Coefficient = 10.0
    """Factor of `dispersion` that widens the plume; PlumeSim's name."""
    dispersion: si.Coefficient = 0.1
    """Widening: points lie across with a standard deviation of dispersion release_rate (x - x0)."""
    radius: si.Length = 0.1
    """Points within this distance of a sensor count for its reading."""

    by_chance: ClassVar[bool] = True

    def errors(self, where: str, context: Context) -> Iterator[str]:
        lines = list(_release(where, self.release_point, context))
        yield from lines
        x, width = self.release_point[0], context.domain.extent[0]
        if not lines and x + self.radius > width:
            yield f"{where}.release_point: x = {x:g} m is at the end of the domain, {width:g} m; move it upwind"


def _release(where: str, point: tuple[float, float], context: Context) -> Iterator[str]:
    """Yield an error if a release point (x, y) [m] is outside the domain; where: path of the gas."""
    if outside := context.outside(np.array([point])):
        yield f"{where}.release_point: {outside}; move the release in"


def nodes(where: str, cell: float, domain: Domain) -> Iterator[str]:
    """Yield errors if a lattice of nodes `cell` [m] apart has too many nodes or is wider than the domain."""
    number = prod(width / cell for width in domain.extent[:2])
    if number > MOST_NODES:
        yield f"{where}.cell: {cell:g} m makes {number:.3g} nodes, at most {MOST_NODES} are allowed; raise it"
    if cell > min(domain.extent[:2]):
        yield f"{where}.cell: {cell:g} m is wider than the domain, {domain.box}; lower it"
