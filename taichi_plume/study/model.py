"""Vocabulary of study.yaml, as frozen pydantic models. Quantities are written as in the scenario."""

import re
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from taichi_plume.scenario.changes import path_of, steps_of
from taichi_plume.scenario.quantities import fault
from taichi_plume.scenario.vocabulary import FileName, Model

NAME = re.compile(r"[a-z][a-z0-9_]{0,31}")
LETTERS = "at most 32 small letters, digits or '_', the first a letter"
SEEDS = ("seed", "air_seed")
"""Keys of a scenario that change only random numbers; they are columns too."""
MOST_SAMPLES = 1 << 16
SPACING = "domain.spacing"
Number = float | str
"""A number, or a text with a unit."""


class StudyAxis(Model):
    """What is varied: one key of the scenario, or several together. Give `values`, `low` and `high`, or `variants`."""

    key: Annotated[str, Field(min_length=1)] | None = None
    """Path of the scenario's key that is varied, such as robots.0.count."""
    keys: Annotated[tuple[Annotated[str, Field(min_length=1)], ...], Field(min_length=1)] | None = None
    """Paths of several keys that all get the same value, instead of `key`."""
    values: Annotated[tuple[Any, ...], Field(min_length=1)] | None = None
    """The values that the key takes one after the other: numbers, texts with units, lists or sections."""
    low: Number | None = None
    """Smallest value of a range, as a number or a text with a unit."""
    high: Number | None = None
    """Largest value of a range, as a number or a text with a unit."""
    count: Annotated[int, Field(ge=2, le=MOST_SAMPLES)] | None = None
    """How many values of the range are taken, both ends among them. Without it the range is sampled, see `sampling`
    and `kind: sensitivity`."""
    spacing: Literal["linear", "log"] = "linear"
    """How values lie in the range: at equal distances, or at equal ratios (log), as for rates and concentrations."""
    variants: Annotated[dict[str, dict[str, Any]], Field(min_length=1)] | None = None
    """Several keys at once under a name: by each name the keys that it changes, with their values. Such as
    {casting: {robots.0.algorithm: {kind: casting}}}."""

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
            raise fault("{key} goes with low and high alone; remove it", {"key": extra[0]})
        if self.variants is None and (self.key is None) == (self.keys is None):
            raise fault("needs key, the path of what is varied, or keys for several with the same value")
        if self.variants is not None and (self.key or self.keys):
            raise fault("has variants, which name their own keys; remove key")
        if self.variants is not None and not all(self.variants.values()):
            raise fault("has a variant that changes nothing; write the base's own value of a key there")
        return self

    @property
    def sampled(self) -> bool:
        """Whether values are drawn from the range."""
        return self.low is not None and self.count is None

    @property
    def paths(self) -> list[str]:
        """Paths of all keys that the axis changes, each once."""
        if self.variants is not None:
            return list(
                dict.fromkeys(canonical(key) for changes in self.variants.values() for key in changes)
            )
        return [canonical(key) for key in (self.keys or (self.key or "",))]


class Sampling(Model):
    """Points spread evenly over the ranges of all axes that have low and high without count."""

    kind: Literal["sobol", "latin"]
    """How points are drawn: a Sobol sequence, of which more may be added later, or a Latin hypercube."""
    count: Annotated[int, Field(ge=1, le=MOST_SAMPLES)] = 64
    """How many points are drawn; of a Sobol sequence a power of two."""
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    """Seed of the random numbers that points are drawn with, independent of the runs' own seeds."""

    @model_validator(mode="after")
    def _even(self) -> "Sampling":
        line = _no_power_of_two("count", self.count)
        if self.kind == "sobol" and line:
            raise fault("{line}", {"line": line})
        return self


class Study(Model):
    """Many runs of one scenario in which some keys take other values."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
    """Name of the study, and of its folder. Letters, digits, dot, underscore and dash."""
    base: FileName
    """Path of the scenario that runs are made of, relative to the study's folder; it has to lie there or below."""
    kind: Literal["sweep", "sensitivity", "refinement"] = "sweep"
    """What is asked. sweep: how results change along the axes; sensitivity: which axis matters how much, by Sobol
    indices; refinement: how results change with the size of the cells, and of which order."""
    axes: Annotated[dict[str, StudyAxis], Field(min_length=1)]
    """What is varied, by the name of its column in the tables. All values of one axis are combined with all of the
    others."""
    sampling: Sampling | None = None
    """How values are drawn for axes that have low and high without count; unless given, none may."""
    samples: Annotated[int, Field(ge=2, le=MOST_SAMPLES)] = 64
    """Base samples of a sensitivity study, a power of two: with d axes, (d + 2) times as many points are run."""
    airs: Annotated[int, Field(ge=1, le=100_000)] = 5
    """In how many airs each point is run: other eddies, gusts and puffs. Intervals are over airs; one air
    says nothing about chance."""
    searches: Annotated[int, Field(ge=1, le=100_000)] = 1
    """How many runs there are in each air, with other starts and noise of the robots."""
    outcomes: Annotated[dict[str, Annotated[str, Field(min_length=1)]], Field(default_factory=dict)]
    """More columns for each run, by name: the path of a number in result.json, such as maps.0.correlation. With
    probes.NAME.QUANTITY it is the mean of a probe over time and points."""
    keep: tuple[Annotated[str, Field(min_length=1)], ...] = ()
    """Names of the files that are kept of each run, such as result.json or report.html. Unless named, only the tables
    are kept."""
    share_air: Literal["exact", "always", "never"] = "exact"
    """Whether the air that runs have in common is solved once and played to them. exact: where that gives the same to
    the bit; always: also where gas of puffs is then only known in the mean of the cells; never: each run solves its
    own."""

    def faults(self) -> list[str]:
        """Errors that concern several keys: lines ``path: message``."""
        return [*self._names(), *self._seeds(), *self._conflicts(), *self._of_kind()]

    @property
    def over_seeds(self) -> bool:
        """Whether an axis sets a seed."""
        return any(path in SEEDS for axis in self.axes.values() for path in axis.paths)

    @property
    def draws(self) -> int:
        """Number of points drawn for each combination of the other axes' values."""
        if self.kind == "sensitivity":
            return self.samples * (len(self.axes) + 2)
        return self.sampling.count if self.sampling else 1

    def _names(self) -> Iterator[str]:
        from taichi_plume.study.columns import TABLE_NAMES, taken  # imports pyarrow

        for name, axis in self.axes.items():
            if not NAME.fullmatch(name):
                yield f"axes: '{name}' is no name of a column; use {LETTERS}"
            elif name in taken() or (name in SEEDS and axis.paths != [name]) or name.startswith("by_"):
                yield f"axes.{name}: is a name that the tables use themselves; choose another one"
            for variant in axis.variants or ():
                if not variant or variant != variant.strip():
                    yield f"axes.{name}.variants: '{variant}' is no name of a variant"
        for name in self.outcomes:
            if not NAME.fullmatch(name):
                yield f"outcomes: '{name}' is no name of a column; use {LETTERS}"
            elif name in TABLE_NAMES or name in SEEDS or name.startswith("by_"):
                yield f"outcomes.{name}: is a name that the tables use themselves; choose another one"
            elif name in self.axes:
                yield f"outcomes.{name}: is the name of an axis; choose another one"

    def _seeds(self) -> Iterator[str]:
        if self.over_seeds:
            for key in ("airs", "searches"):
                if key in self.model_fields_set:
                    yield f"{key}: the axes give the seeds themselves; remove {key}, or that axis"

    def _conflicts(self) -> Iterator[str]:
        """Refuse two axes that change the same key, or one of which changes a part of the other's key."""
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
                    yield f"axes.{name}: {_both(path, clash[1], f'axes.{clash[0]} ')}; a key can be on one axis only"
            named += [(name, path) for path in axis.paths]

    def _of_kind(self) -> Iterator[str]:
        sampled = [name for name, axis in self.axes.items() if axis.sampled]
        if self.kind == "sensitivity":
            if self.sampling is not None:
                yield "sampling: a sensitivity study draws its points itself; remove it, and use samples"
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
            yield "sampling: no axis is drawn; give one low and high without count"
        if self.kind == "refinement":
            axis = next(iter(self.axes.values()))
            if len(self.axes) > 1 or sampled or axis.variants is not None or SPACING not in axis.paths:
                yield f"axes: a refinement study takes one axis, with values of {SPACING}"
            elif len(axis.values or ()) < 3 and (axis.count or 0) < 3:
                yield "axes: a refinement study takes three values or more, from which the order is seen"


def canonical(path: str) -> str:
    """Write a path in the canonical way: ``robots.00.count`` becomes ``robots[0].count``."""
    return path_of([str(int(step)) if step.isdecimal() else step for step in steps_of(path)])


def _overlap(path: str, other: str) -> bool:
    """Whether two paths are the same, or one is a part of the other."""
    shorter, longer = sorted((path, other), key=len)
    return longer == shorter or longer.startswith((f"{shorter}.", f"{shorter}["))


def _both(path: str, other: str, who: str = "") -> str:
    """Return the message about two overlapping paths; who: the axis that changes the other one."""
    if path == other:
        return f"changes {path}, as {who}does" if who else f"changes {path} twice"
    part = "which is a part of it" if len(other) > len(path) else "of which it is a part"
    return f"changes {path}, and {who}{other}, {part}"


def _no_power_of_two(key: str, count: int) -> str:
    """Return an error line if `count` is no power of two, else ""."""
    below = 1 << (count.bit_length() - 1)
    near = f"such as {below} or {2 * below}"
    return f"{key}: got {count}: a Sobol sequence takes a power of two, {near}" if count != below else ""
