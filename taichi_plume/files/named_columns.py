"""Tables whose header names the columns: names, units, decimal mark, times and missing values as the file states them.

The header is the line above the numbers that names the needed columns: the first line, a comment, or a line below a
preamble (COMSOL's "%", CFD-Post's "[Data]"). Units stand behind the names, "X (mm)" or "u [ m s^-1 ]", or apart, as
COMSOL's "Length unit: mm". Numbers may have decimal commas where another mark separates them; times may be ISO 8601.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from taichi_plume.files.conventions import ConventionError, in_si, is_missing, iso_times, split_unit, times_of
from taichi_plume.files.tables import Table, TextFile, cells_of, delimiter_of, listed
from taichi_plume.scenario.quantities import conversion

LONGEST_PREAMBLE = 200  # lines
MARKS = (",", ";", "\t", None)  # between cells; None: blanks
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf)"
IS_NUMBER = re.compile(NUMBER, re.IGNORECASE)
IS_COMMA_NUMBER = re.compile(NUMBER.replace(r"\.", ","), re.IGNORECASE)
IS_TIME = re.compile(r"(\d{4}-\d\d?-\d\d?([T ].*)?)|(\d{1,2}:\d\d(:\d\d([.,]\d+)?)?)")
LENGTH_UNIT = re.compile(r"length unit\W+(\w+)", re.IGNORECASE)
SECTION = re.compile(r"\s*\[[^\]]*\]\s*")  # of CFD-Post
APART = re.compile(r"\s+(?=[\[(][^\])]*[\])])")  # between a name and its unit


@dataclass(frozen=True)
class Column:
    """Column that a reader accepts: names in lower case, preferred ones first; unit: of its values.

    unit is "" for plain numbers. is_text: whether its cells are texts; is_needed: whether a table needs the column.
    """

    names: tuple[str, ...]
    unit: str = ""
    is_text: bool = False
    is_needed: bool = True


class Picked(NamedTuple):
    """Column of a file: its index from 0 on, its header cell, and the unit there, "" if none."""

    index: int
    name: str
    unit: str


@dataclass
class NamedTable:
    """Columns of a table by the reader's keys, in the reader's units; missing numbers are NaN.

    picked: where each column stands; remarks: what was assumed; names: of all columns; length_unit: of lengths without
    a unit behind their name.
    """

    values: dict[str, np.ndarray]
    picked: dict[str, Picked]
    remarks: tuple[str, ...]
    table: Table
    names: list[str]
    length_unit: str = ""
    accepted: Mapping[str, Column] = field(default_factory=dict)

    def unit_of(self, key: str) -> str:
        """Return the unit that the file states for a column, "" if none."""
        return self.picked[key].unit or (self.length_unit if self.accepted[key].unit == "m" else "")


def pick(
    names: Sequence[str], accepted: Mapping[str, Column], given: Mapping[str, str] | None = None
) -> dict[str, Picked]:
    """Return the column of each accepted key in a header; keys without a column are left out.

    given: header cells that the user names for some keys, with or without a unit, or numbers of columns from 1 on.
    Raises ConventionError if a named column is missing, or several columns have one name or an unknown unit.
    """
    whole = [" ".join(name.strip("'\"\ufeff ").split()).lower() for name in names]
    split = [split_unit(name) for name in names]
    picked = {}
    for key, column in accepted.items():
        if given and key in given:
            picked[key] = _named(key, given[key], names, whole, split, column)
            continue
        for form in column.names:
            here = [n for n, name in enumerate(whole) if name == form]
            stated = [n for n, (name, _) in enumerate(split) if name == form and n not in here]
            if len(here) + len(stated) > 1:
                raise ConventionError(f"has several columns '{form}'; remove or rename all but one")
            if here or stated:
                n = (here or stated)[0]
                unit = (
                    split[n][1] if stated or _is_unit(split[n][1], column) else ""
                )  # reading_ppm is a name of ours
                picked[key] = Picked(n, names[n], unit)
                _require_unit(picked[key], column)
                break
    return picked


def _named(
    key: str,
    given: str,
    names: Sequence[str],
    whole: list[str],
    split: list[tuple[str, str]],
    column: Column,
) -> Picked:
    """Return the column that the user names for a key. Raises ConventionError."""
    text = " ".join(given.split()).lower()
    name, unit = split_unit(given)
    for cell, unit_given in ((text, ""), (name, unit)):
        for known in (whole, [each for each, _ in split]):
            here = [n for n, each in enumerate(known) if each == cell]
            if len(here) > 1:
                raise ConventionError(f"has several columns '{given}'; remove or rename all but one")
            if here:
                n = here[0]
                stated = split[n][1] if _is_unit(split[n][1], column) else ""
                found = Picked(n, names[n], unit_given or stated)
                _require_unit(found, column)
                return found
    if name.isdigit() and 1 <= int(name) <= len(names):
        return Picked(int(name) - 1, f"column {name}", unit)
    raise ConventionError(f"has no column '{given}' for {key}; it has {listed(names)}")


def _is_unit(unit: str, column: Column) -> bool:
    try:
        conversion(unit.partition(" since ")[0], column.unit)
    except ValueError:
        return False
    return True


def _require_unit(picked: Picked, column: Column) -> None:
    if picked.unit and column.unit and not _is_unit(picked.unit, column):
        raise ConventionError(f"{picked.name}: '{picked.unit}' is no unit that converts to {column.unit}")


def convert(values: np.ndarray, picked: Picked, column: Column, length_unit: str = "") -> np.ndarray:
    """Return a column's numbers in the unit of the reader. Raises ConventionError."""
    if column.unit == "s":
        return times_of(values, picked.unit)
    return in_si(values, picked.unit or (length_unit if column.unit == "m" else ""), column.unit)


def read_columns(
    file: TextFile,
    accepted: Mapping[str, Column],
    given: Mapping[str, str] | None = None,
    missing: Sequence[float] = (),
    without_header: Sequence[str] = (),
    gaps: bool = False,
) -> NamedTable:
    """Read the accepted columns of a text file, converted to the units of the reader.

    given: see `pick`. missing: numbers that mean none, besides the usual ones. without_header: keys of the columns of a
    file without a header, if it has as many. gaps: whether cells may be empty. Raises the file's error.
    """
    first, mark = _first_row(file)
    try:
        picked, all_names = _header(file, first, mark, accepted, given, without_header)
    except ConventionError as error:
        raise file.fault(f"{file.path}: {error}") from None
    lines = file.lines
    end = next((n for n in range(first, len(lines)) if SECTION.fullmatch(lines[n])), len(lines))
    rows = [n for n in file.rows(first) if n < end]
    width = max(len(all_names), 1 + max(column.index for column in picked.values()))
    if rows:
        width = max(width if mark else 0, len(cells_of(lines[rows[0]], mark)))  # some headers end with a mark
    table = Table(file, rows, width, mark, gaps=gaps, decimal=_decimal(lines, rows, mark))
    preamble = "\n".join(lines[:first])
    length = LENGTH_UNIT.search(preamble)
    unit = length[1] if length else ""
    values, remarks = _values(table, accepted, picked, unit, missing)
    return NamedTable(values, picked, (*file.remarks, *remarks), table, all_names, unit, accepted)


def _values(
    table: Table,
    accepted: Mapping[str, Column],
    picked: Mapping[str, Picked],
    length: str,
    missing: Sequence[float],
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the values by key, and remarks on missing ones; length: unit of lengths without a unit."""
    path, fault = table.file.path, table.file.fault
    dated = [
        key for key, column in picked.items() if accepted[key].unit == "s" and _has_dates(table, column.index)
    ]
    keys = [key for key in picked if not accepted[key].is_text and key not in dated]
    numbers = table.numbers(*(picked[key].index for key in keys)) if keys else np.empty((len(table), 0))
    values, remarks = {}, []
    for key, column in zip(keys, numbers.T, strict=True):
        none = is_missing(column, missing) & np.isfinite(column)
        if none.any():
            which = ", ".join(f"{value:g}" for value in np.unique(column[none]))
            remarks.append(
                f"{none.sum()} of {len(column)} {picked[key].name} are {which}, which counts as missing"
            )
        try:
            values[key] = convert(np.where(none, np.nan, column), picked[key], accepted[key], length)
        except ConventionError as error:
            raise fault(f"{path}: {picked[key].name}: {error}") from None
    for key, column in picked.items():
        if accepted[key].is_text:
            values[key] = table.texts(column.index)
    for key in dated:
        values[key] = iso_times(list(table.texts(picked[key].index)))
        wrong = np.flatnonzero(np.isnan(values[key]))
        if len(wrong):
            raise table.wrong(int(wrong[0]), "its time is no date such as 2026-01-01T10:00:00.5")
    return values, remarks


def _has_dates(table: Table, column: int) -> bool:
    return len(table) > 0 and bool(
        IS_TIME.fullmatch(cells_of(table.file.lines[table.rows[0]], table.delimiter)[column])
    )


def _first_row(file: TextFile) -> tuple[int, str | None]:
    """Return the index of the first line of numbers, and the mark between its cells; else the line after the header."""
    for n in file.rows(0)[:LONGEST_PREAMBLE]:
        numeric = {mark: _numeric(file.lines[n], mark) for mark in MARKS}
        mark = max(numeric, key=lambda mark: numeric[mark])
        if numeric[mark] >= 2:
            return n, mark
    first = (file.rows(0) or [0])[0]
    return first + 1, delimiter_of(file.lines[first])


def _numeric(line: str, mark: str | None) -> int:
    """Return the number of cells of a line that are numbers, 0 if under a quarter are; between blanks, two thirds."""
    cells = cells_of(line, mark)
    forms = (IS_NUMBER, IS_TIME) if mark == "," else (IS_NUMBER, IS_TIME, IS_COMMA_NUMBER)
    count = sum(any(form.fullmatch(cell) for form in forms) for cell in cells)
    return count if count >= (0.25 if mark else 0.66) * len(cells) else 0


def _decimal(lines: Sequence[str], rows: Sequence[int], mark: str | None) -> str:
    """Return the decimal mark of a table: a comma if cells such as 0,5 stand between other marks."""
    if mark == ",":
        return "."
    for n in rows:
        if "," in lines[n] and any(
            "," in cell and IS_COMMA_NUMBER.fullmatch(cell) for cell in cells_of(lines[n], mark)
        ):
            return ","
    return "."


def _header(
    file: TextFile,
    first: int,
    mark: str | None,
    accepted: Mapping[str, Column],
    given: Mapping[str, str] | None,
    without: Sequence[str],
) -> tuple[dict[str, Picked], list[str]]:
    """Return the picked columns and all names of the header above line `first`. Raises ConventionError."""
    needed = [key for key, column in accepted.items() if column.is_needed]
    best: tuple[list[str], list[str]] | None = None
    error: ConventionError | None = None
    for line in reversed(file.lines[max(0, first - LONGEST_PREAMBLE) : first]):
        text = line.strip().lstrip("#% ")
        for between in dict.fromkeys((mark, delimiter_of(text))):
            names = cells_of(APART.sub("", text) if between is None else text, between)
            if not any(names):
                continue
            try:
                picked = pick(names, accepted, given)
            except ConventionError as fault:
                error = error or fault
                continue
            lacks = [key for key in needed if key not in picked]
            if not lacks:
                return picked, names
            if best is None or len(lacks) < len(best[0]):
                best = lacks, names
    width = len(cells_of(file.lines[first], mark)) if first < len(file.lines) else 0
    if (
        given
        and all(text.partition(" ")[0].isdigit() for text in given.values())
        and not set(needed) - set(given)
    ):
        names = [f"column {n + 1}" for n in range(width)]
        return pick(names, {key: accepted[key] for key in given}, given), names
    if without and len(without) == width and best is None and mark is None:
        return {key: Picked(n, key, "") for n, key in enumerate(without)}, list(without)
    if error is not None:
        raise error
    lacks, names = best or (needed, [])
    raise ConventionError(
        f"has no column {', '.join(lacks)}; "
        + (f"it has {listed(names)}" if names else "no line above its numbers names the columns")
    )
