"""Keys of a parameter study's file study.yaml as frozen pydantic models. Quantities are written as in the scenario."""

import re
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from taichi_plume.quantities import Number, fault
from taichi_plume.scenario.changes import path_of, steps_of
from taichi_plume.scenario.vocabulary import FileName, Model

NAME = re.compile(r"[a-z][a-z0-9_]{0,31}")
LETTERS = "at most 32 small letters, digits or '_', the first a letter"
SEEDS = ("seed", "air_seed")
"""Keys of a scenario that change only random numbers. They are columns of the tables, too."""
MOST_SAMPLES = 1 << 16
SPACING = "domain.spacing"


class StudyAxis(Model):
    """Axis: one key of the scenario to vary, or several together. Give `values`, `low` and `high`, or `variants`."""

    key: Annotated[str, Field(min_length=1)] | None = None
    """Path of the scenario's key to vary, such as robots.0.count."""
    keys: Annotated[tuple[Annotated[str, Field(min_length=1)], ...], Field(min_length=1)] | None = None
    """Paths of several keys that all get the same value, instead of `key`."""
    values: Annotated[tuple[Any, ...], Field(min_length=1)] | None = None
    """List of the key's values: numbers, texts with units, lists or sections."""
    low: Number | None = None
    """Smallest value of a range, as a number or a text with a unit."""
    high: Number | None = None
    """Largest value of a range, as a number or a text with a unit."""
    count: Annotated[int, Field(ge=2, le=MOST_SAMPLES)] | None = None
    """Number of values in the range, both ends included. Without count the range is sampled, see `sampling` and
    `kind: sensitivity`."""
    spacing: Literal["linear", "log"] = "linear"
    """Spacing of the values in the range: equal distances, or equal ratios (log), as for rates and concentrations."""
    variants: Annotated[dict[str, dict[str, Any]], Field(min_length=1)] | None = None
    """Named sets of changes: for each name the keys that change together, with their values.

    An example: {casting: {robots.0.algorithm: {kind: casting}}}.
    """

    @model_validator(mode="after")
    def _one_form(self) -> "StudyAxis":
        given = [name for name in ("values", "low", "variants") if vars(self)[name] is not None]
        if self.high is not None and "low" not in given:
            raise fault("has high but no low")
        if len(given) != 1:
            has = f"has {' and '.join(given)}" if given else "has no values"
            raise fault("{has}; give either values, or low and high, or variants", {"has": has})
        if self.low is not None and self.high is None:
            raise fault("has low but no high")
        extra = [name for name in ("count", "spacing") if name in self.model_fields_set and given != ["low"]]
        if extra:
            raise fault("{key} goes only with low and high; remove it", {"key": extra[0]})
        if self.variants is None and (self.key is None) == (self.keys is None):
            raise fault("needs key, the path of the key to vary, or keys for several with the same value")
        if self.variants is not None and (self.key or self.keys):
            raise fault("has variants, which name the keys themselves; remove key")
        if self.variants is not None and not all(self.variants.values()):
            raise fault("has a variant that changes nothing; set a key there to its value in the base")
        return self

    @property
    def sampled(self) -> bool:
        """Whether the axis has a range (low, high) without count, from which the study samples values."""
        return self.low is not None and self.count is None

    @property
    def paths(self) -> list[str]:
        """Paths of all scenario keys that the axis changes, in canonical form, each once."""
        if self.variants is not None:
            return list(
                dict.fromkeys(canonical(key) for changes in self.variants.values() for key in changes)
            )
        return [canonical(key) for key in (self.keys or (self.key or "",))]


class Sampling(Model):
    """Points spread evenly over the ranges of all axes that have low and high without count."""

    kind: Literal["sobol", "latin"]
    """Sampling method: a Sobol sequence, which can be extended later, or a Latin hypercube."""
    count: Annotated[int, Field(ge=1, le=MOST_SAMPLES)] = 64
    """Number of points; for a Sobol sequence a power of two."""
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    """Seed of the sampling, independent of the seeds of the runs."""

    @model_validator(mode="after")
    def _even(self) -> "Sampling":
        line = _no_power_of_two("count", self.count)
        if self.kind == "sobol" and line:
            raise fault("{line}", {"line": line})
        return self


class Study(Model):
    """Parameter study: many runs of one scenario with different values of some keys."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
    """Name of the study, and of its folder. Letters, digits, dot, underscore and dash."""
    base: FileName
    """Path of the base scenario, relative to the study's folder. The file must lie in that folder or below."""
    kind: Literal["sweep", "sensitivity", "refinement"] = "sweep"
    """Kind of study. sweep: results along the axes; sensitivity: influence of each axis, by Sobol indices; refinement:
    results over the cell size, and the order of convergence."""
    axes: Annotated[dict[str, StudyAxis], Field(min_length=1)]
    """Axes by the names of their columns in the tables. All values of one axis are combined with all values of the
    others."""
    sampling: Sampling | None = None
    """Sampling of the axes that have low and high without count; required if there are such axes."""
    samples: Annotated[int, Field(ge=2, le=MOST_SAMPLES)] = 64
    """Base samples of a sensitivity study, a power of two. With d axes the study has (d + 2) times as many points."""
    airs: Annotated[int, Field(ge=1, le=100_000)] = 5
    """Number of airs per point: realisations of eddies, gusts and puffs. Intervals are over airs; below three airs
    there is none."""
    searches: Annotated[int, Field(ge=1, le=100_000)] = 1
    """Number of runs in each air, with different starts and noise of the robots."""
    outcomes: Annotated[dict[str, Annotated[str, Field(min_length=1)]], Field(default_factory=dict)]
    """Additional columns of each run, by name. A value is the path of a number in result.json, such as
    maps.0.correlation, or probes.NAME.QUANTITY for the mean of a probe over time and points."""
    keep: tuple[Annotated[str, Field(min_length=1)], ...] = ()
    """Names of the files to keep of each run, such as result.json or report.html. By default only the tables are
    kept."""
    share_air: Literal["exact", "always", "never"] = "exact"
    """Whether an air that several runs share is solved once and played to them. exact: if the results are equal to the
    bit; always: also if the film holds only the cell means of puffs; never: each run solves its
    own air."""

    def faults(self) -> list[str]:
        """Return all errors of study.yaml that concern several keys, each as a line ``path: message``."""
        return [*self._names(), *self._seeds(), *self._conflicts(), *self._of_kind()]

    @property
    def over_seeds(self) -> bool:
        """Whether an axis of the study sets a random seed (scenario key seed or air_seed)."""
        return any(path in SEEDS for axis in self.axes.values() for path in axis.paths)

    @property
    def draws(self) -> int:
        """Number of sampled points for each combination of values of the other axes; 1 without sampling."""
        if self.kind == "sensitivity":
            return self.samples * (len(self.axes) + 2)
        return self.sampling.count if self.sampling else 1

    def _names(self) -> Iterator[str]:
        from taichi_plume.studies.columns import TABLE_NAMES, taken  # imports pyarrow

        for name, axis in self.axes.items():
            if not NAME.fullmatch(name):
                yield f"axes: '{name}' is not a valid name of a column; use {LETTERS}"
            elif name in taken() or (name in SEEDS and axis.paths != [name]) or name.startswith("by_"):
                yield f"axes.{name}: is a name that the tables use already; choose another name"
            for variant in axis.variants or ():
                if not variant or variant != variant.strip():
                    yield f"axes.{name}.variants: '{variant}' must not be empty or have blanks at its ends"
        for name in self.outcomes:
            if not NAME.fullmatch(name):
                yield f"outcomes: '{name}' is not a valid name of a column; use {LETTERS}"
            elif name in TABLE_NAMES or name in SEEDS or name.startswith("by_"):
                yield f"outcomes.{name}: is a name that the tables use already; choose another name"
            elif name in self.axes:
                yield f"outcomes.{name}: is the name of an axis; choose another name"

    def _seeds(self) -> Iterator[str]:
        if self.over_seeds:
            for key in ("airs", "searches"):
                if key in self.model_fields_set:
                    yield f"{key}: an axis sets the seeds; remove {key}, or that axis"

    def _conflicts(self) -> Iterator[str]:
        """Yield an error for each axis that changes a key twice, or a key that another axis changes too."""
        named: list[tuple[str, str]] = []
        for name, axis in self.axes.items():
            forms = [list(map(canonical, changes)) for changes in (axis.variants or {}).values()]
            for paths in forms or [axis.paths]:
                for n, path in enumerate(paths):
                    other = next((before for before in paths[:n] if _overlap(before, path)), None)
                    if other is not None:
                        yield f"axes.{name}: {_both(path, other)}"
            for path in axis.paths:
                clash = next(((who, taken) for who, taken in named if _overlap(taken, path)), None)
                if clash is not None:
                    yield f"axes.{name}: {_both(path, clash[1], f'axes.{clash[0]} ')}; only one axis may change a key"
            named += [(name, path) for path in axis.paths]

    def _of_kind(self) -> Iterator[str]:
        sampled = [name for name, axis in self.axes.items() if axis.sampled]
        if self.kind == "sensitivity":
            if self.sampling is not None:
                yield "sampling: a sensitivity study has its own sampling; remove sampling, and use samples"
            for name in self.axes.keys() - set(sampled):
                yield f"axes.{name}: a sensitivity study takes low and high without count"
            if line := _no_power_of_two("samples", self.samples):
                yield line
            return
        if "samples" in self.model_fields_set:
            yield "samples: is for kind: sensitivity; use sampling here"
        if sampled and self.sampling is None:
            yield f"axes.{sampled[0]}: has low and high; give count, or sampling for the study"
        if self.sampling is not None and not sampled:
            yield "sampling: no axis is sampled; give an axis low and high without count"
        if self.kind == "refinement":
            axis = next(iter(self.axes.values()))
            if len(self.axes) > 1 or sampled or axis.variants is not None or SPACING not in axis.paths:
                yield f"axes: a refinement study takes one axis, with values of {SPACING}"
            elif len(axis.values or ()) < 3 and (axis.count or 0) < 3:
                yield "axes: a refinement study needs at least three values to estimate the order"


def canonical(path: str) -> str:
    """Return the canonical form of a scenario key's path: ``robots.00.count`` becomes ``robots[0].count``."""
    return path_of([str(int(step)) if step.isdecimal() else step for step in steps_of(path)])


def _overlap(path: str, other: str) -> bool:
    """Return whether two paths are the same scenario key, or one is a section that contains the other."""
    shorter, longer = sorted((path, other), key=len)
    return longer == shorter or longer.startswith((f"{shorter}.", f"{shorter}["))


def _both(path: str, other: str, who: str = "") -> str:
    """Return the error message for two overlapping paths of keys; who: name of the axis that changes `other`."""
    if path == other:
        return f"changes {path}, as {who}does" if who else f"changes {path} twice"
    part = "which is a part of it" if len(other) > len(path) else "of which it is a part"
    return f"changes {path}, and {who}{other}, {part}"


def _no_power_of_two(key: str, count: int) -> str:
    """Return an error line if the value `count` of a study key is not a power of two, else an empty text."""
    below = 1 << (count.bit_length() - 1)
    near = f"such as {below} or {2 * below}"
    return f"{key}: got {count}: a Sobol sequence takes a power of two, {near}" if count != below else ""
