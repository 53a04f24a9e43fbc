"""Tables whose header names the columns: names, units, decimal mark, times and missing values as the file states them.

The header is a line above the numbers that names the needed columns, and has as many cells as a row: the first line, a
comment, or a line below a preamble (COMSOL's "%", CFD-Post's "[Data]"). Units stand behind the names, "X (mm)" or
"u [ m s^-1 ]", in a line of their own beside the header, or apart, as COMSOL's "Length unit: mm". Numbers may have
decimal commas where another mark separates them; times may be ISO 8601.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from taichi_plume.files.conventions import (
    ConventionError,
    factor_of,
    in_si,
    is_missing,
    iso_times,
    split_unit,
    times_of,
)
from taichi_plume.files.tables import Table, TextFile, cells_of, delimiter_of, listed

LONGEST_PREAMBLE = 200  # lines
MARKS = ("\t", ";", ",", None)  # between cells, in order of preference; None: blanks
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?|[-+]?(?:nan|inf)"
IS_NUMBER = re.compile(NUMBER, re.IGNORECASE)
IS_COMMA_NUMBER = re.compile(NUMBER.replace(r"\.", ","), re.IGNORECASE)
IS_TIME = re.compile(r"\d{4}-\d\d?-\d\d?([T ].*)?|\d{1,2}:\d\d:\d\d([.,]\d+)?")
LENGTH_UNIT = re.compile(r"length unit\W+(\w+)", re.IGNORECASE)
SECTION = re.compile(r"\s*\[([^\]]*)\]\s*")  # of CFD-Post
APART = re.compile(r"\s+(?=[\[(][^\])]*[\])])")  # between a name and its unit
AT_A_TIME = re.compile(r"\s*@.*$")  # COMSOL: u (m/s) @ t=0.5
AT_LEAST = 2  # numbers in a row


@dataclass(frozen=True)
class Column:
    """Column that a reader accepts: names in lower case, preferred ones first; unit: of its values.

    pattern: of further names. unit is "" for plain numbers. is_text: whether its cells are texts; is_needed: whether a
    table needs the column; may_lack: whether the numbers that the user names as missing may stand in the column.
    """

    names: tuple[str, ...]
    unit: str = ""
    is_text: bool = False
    is_needed: bool = True
    may_lack: bool = False
    pattern: str = ""


class Picked(NamedTuple):
    """Column of a file: its index from 0 on, its header cell, and the unit there, "" if none."""

    index: int
    name: str
    unit: str


@dataclass
class NamedTable:
    """Columns of a table by the reader's keys, in the reader's units; missing numbers are NaN.

    picked: where each column stands, with its unit; remarks: what was assumed; names: of all columns.
    """

    values: dict[str, np.ndarray]
    picked: dict[str, Picked]
    remarks: tuple[str, ...]
    table: Table
    names: list[str]


# ---------------------------------------------------------------- columns of a header


def pick(
    names: Sequence[str], accepted: Mapping[str, Column], given: Mapping[str, str] | None = None
) -> dict[str, Picked]:
    """Return the column of each accepted key in a header; keys without a column are left out.

    given: header cells that the user names for some keys, with or without a unit, or numbers of columns from 1 on.
    Raises ConventionError if a named column is missing, or several columns have one name or an unknown unit.
    """
    plain = [AT_A_TIME.sub("", name) for name in names]
    whole = [" ".join(name.strip("'\"\ufeff ").split()).lower() for name in plain]
    split = [split_unit(name) for name in plain]
    picked = {}
    for key, column in accepted.items():
        if given and key in given:
            n, unit = _named(key, given[key], names, whole, split)
            stated = split[n][1] if _is_unit(split[n][1], column) else ""
            unit = unit or stated
        elif (n := _index_of(column, whole, split)) is not None:
            unit = split[n][1]
            if _is_name(whole[n], column) and not _is_unit(unit, column):  # such as velocity[i]
                unit = ""
        else:
            continue
        if (
            unit and column.unit not in ("", "s") and not _is_unit(unit, column)
        ):  # of times: when they are read
            raise ConventionError(f"{names[n]}: '{unit}' is no unit that converts to {column.unit}")
        picked[key] = Picked(n, names[n], unit if column.unit else "")
    return picked


def _index_of(column: Column, whole: list[str], split: list[tuple[str, str]]) -> int | None:
    """Return the index of a column in a header; None if it lacks. Raises ConventionError if several have its name."""
    for form in (*map(re.escape, column.names), *filter(None, [column.pattern])):
        matches = re.compile(form).fullmatch
        here = [n for n, name in enumerate(whole) if matches(name) or matches(split[n][0])]
        if len(here) > 1 or not column.is_needed:  # T (degC) is no time
            here = [n for n in here if matches(whole[n]) or not split[n][1] or _is_unit(split[n][1], column)]
        if here:
            return _only(here, split[here[0]][0])
    return None


def _only(here: list[int], name: str) -> int:
    if len(here) > 1:
        raise ConventionError(f"has several columns '{name}'; remove or rename all but one")
    return here[0]


def _is_name(text: str, column: Column) -> bool:
    return text in column.names or bool(column.pattern and re.fullmatch(column.pattern, text))


def _named(
    key: str, given: str, names: Sequence[str], whole: list[str], split: list[tuple[str, str]]
) -> tuple[int, str]:
    """Return the index of the column that the user names for a key, and the unit given. Raises ConventionError."""
    name, unit = split_unit(given)
    for cell, unit_given in ((" ".join(given.split()).lower(), ""), (name, unit)):
        for known in (whole, [each for each, _ in split]):
            if here := [n for n, each in enumerate(known) if each == cell]:
                return _only(here, given), unit_given
    if name.isdigit() and 1 <= int(name) <= len(names) and not any(each.isdigit() for each in whole):
        return int(name) - 1, unit
    raise ConventionError(f"has no column '{given}' for {key}; it has {listed(names)}")


def _is_unit(unit: str, column: Column) -> bool:
    return factor_of(unit.partition(" since ")[0], column.unit) is not None


def cleared(
    values: np.ndarray, picked: Picked, column: Column, missing: Sequence[float]
) -> tuple[np.ndarray, list[str]]:
    """Return a column's numbers in the unit of the reader, NaN where missing, and remarks. Raises ConventionError."""
    remarks = []
    if column.unit:
        none = is_missing(values, missing if column.may_lack else ())
        stated = none & np.isfinite(values)
        if stated.any():
            which = ", ".join(f"{value:g}" for value in np.unique(values[stated]))
            of = f"{stated.sum()} of {len(values)} values of {picked.name}"
            remarks.append(f"{of} are {which}, which counts as missing")
        values = np.where(none, np.nan, values)
    converted = (
        times_of(values, picked.unit) if column.unit == "s" else in_si(values, picked.unit, column.unit)
    )
    return converted, remarks


# ---------------------------------------------------------------- text files


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
    first, mark, picked, names = _layout(file, accepted, given, without_header)
    rows, end = _rows(file, first, names)
    width = max(len(names), 1 + max(column.index for column in picked.values()))
    if rows:
        cells = len(cells_of(file.lines[rows[0]], mark))
        width = cells if mark is None or not any(names[cells:]) else max(width, cells)
    table = Table(file, rows, width, mark, gaps=gaps, decimal=_decimal(file.lines, rows, mark))
    length = LENGTH_UNIT.search("\n".join(file.lines[:first]))
    lengths = [key for key in picked if accepted[key].unit == "m"]
    stated = {length[1]} if length else {picked[key].unit for key in lengths} - {""}
    bare = [key for key in lengths if not picked[key].unit]
    if len(stated) == 1 and bare:
        unit = stated.pop()
        picked |= {key: picked[key]._replace(unit=unit) for key in bare}
        if not length:
            end.append(
                f"{', '.join(picked[key].name for key in bare)} without a unit are taken in {unit}, as the others"
            )
    try:
        values, remarks = _values(table, accepted, picked, missing)
    except ConventionError as error:
        raise file.fault(f"{file.path}: {error}") from None
    return NamedTable(values, picked, (*file.remarks, *end, *remarks), table, names)


def _layout(
    file: TextFile, accepted: Mapping[str, Column], given: Mapping[str, str] | None, without: Sequence[str]
) -> tuple[int, str | None, dict[str, Picked], list[str]]:
    """Return the first row, the mark between cells, the picked columns and all names. Raises the file's error."""
    error: ConventionError | None = None
    rows = file.rows(0)[:LONGEST_PREAMBLE]
    cells = {n: _mark(file.lines[n]) for n in rows}
    for before, n in pairwise([-1, *rows]):
        if cells[n][1] < AT_LEAST or (before >= 0 and cells[before] == cells[n]):
            continue
        try:
            return n, cells[n][0], *_header(file, n, cells[n][0], accepted, given, without)
        except ConventionError as fault:
            error = error or fault
    if error is None:  # no row of numbers
        first = (rows or [0])[0] + 1
        try:
            mark = delimiter_of(file.lines[first - 1])
            return first, mark, *_header(file, first, mark, accepted, given, ())
        except ConventionError as fault:
            error = fault
    raise file.fault(f"{file.path}: {error}")


def _mark(line: str) -> tuple[str | None, int]:
    """Return the mark between the cells of a row, by which most cells are numbers, and the number of these."""
    best: tuple[float, str | None, int] = (0.0, None, 0)
    for mark in MARKS:
        cells = cells_of(line, mark)
        forms = (IS_NUMBER, IS_TIME) if mark == "," else (IS_NUMBER, IS_TIME, IS_COMMA_NUMBER)
        count = sum(any(form.fullmatch(cell) for form in forms) for cell in cells)
        share = count / max(1, sum(map(bool, cells)))
        if count >= AT_LEAST and share >= (0.25 if mark else 0.66) and share > best[0]:
            best = share, mark, count
    return best[1:]


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
    row = cells_of(file.lines[first], mark) if first < len(file.lines) else []
    best: tuple[list[str], list[str]] | None = None
    error: ConventionError | None = None
    for n in reversed(range(max(0, first - LONGEST_PREAMBLE), first)):
        for names in _splits(file.lines[n].strip().lstrip("#% "), mark, len(row)):
            if not any(names):
                continue
            try:
                picked = pick(names, accepted, given)
            except ConventionError as fault:
                error = error or fault
                continue
            lacks = [key for key in needed if key not in picked]
            if best is None or len(lacks) < len(best[0]):
                best = lacks, names
            if lacks:
                continue
            if _fits(names, row, mark):
                beside = [file.lines[k] for k in (n + 1, n - 1) if k != first and 0 <= k < len(file.lines)]
                return _with_units(picked, accepted, beside, mark, len(names)), names
            error = ConventionError(
                f"its header names {len(names)} columns ({listed(names)}), its rows have {len(row)}; give columns"
            )
    numbers = [f"column {n + 1}" for n in range(len(row))]
    if (
        given
        and not set(needed) - set(given)
        and all(split_unit(text)[0].isdigit() for text in given.values())
    ):
        return pick(numbers, {key: accepted[key] for key in given}, given), numbers
    if without and len(without) == len(row) and best is None and error is None:
        return {key: Picked(n, key, "") for n, key in enumerate(without)}, list(without)
    if error is not None:
        raise error
    lacks, names = best or (needed, [])
    has = f"it has {listed(names)}" if names else "no line above its numbers names the columns"
    raise ConventionError(f"has no column {', '.join(lacks or needed)}; {has}")


def _splits(text: str, mark: str | None, width: int) -> list[list[str]]:
    """Return the ways to split a header into names: by the mark of the rows, or others that give a name per cell."""
    ways = [cells_of(APART.sub("", text) if mark is None else text, mark)]
    others = [[part.strip() for part in re.split(r"\s{2,}|\t", text)], cells_of(APART.sub("", text), None)]
    own = delimiter_of(text)
    others += [cells_of(text, own)] if own else []
    return [ways[0], *(names for names in others if len(names) == width or not width)]


def _fits(names: Sequence[str], cells: Sequence[str], mark: str | None) -> bool:
    """Return whether a header has a name for each cell of a row; between blanks it has no further ones."""
    filled = next((n for n in range(len(cells), 0, -1) if cells[n - 1]), 0)
    return not cells or (len(names) == len(cells) if mark is None else filled <= len(names))


def _with_units(
    picked: dict[str, Picked],
    accepted: Mapping[str, Column],
    lines: Sequence[str],
    mark: str | None,
    width: int,
) -> dict[str, Picked]:
    """Return the columns with the units of a line beside the header, if one has a unit for each number."""
    for line in lines:
        text = line.strip().lstrip("#% ")
        cells = [cell.strip("[](){} '\"") for cell in cells_of(text, mark)]
        stated = {key: cells[column.index] for key, column in picked.items() if column.index < len(cells)}
        of_numbers = {key: unit for key, unit in stated.items() if accepted[key].unit}
        if (
            len(cells) == width
            and of_numbers
            and all(_is_unit(u, accepted[k]) for k, u in of_numbers.items())
        ):
            return {key: c._replace(unit=c.unit or of_numbers.get(key, "")) for key, c in picked.items()}
    return picked


def _rows(file: TextFile, first: int, names: Sequence[str]) -> tuple[list[int], list[str]]:
    """Return the lines of the table's rows, of all its sections, and remarks. Raises the file's error.

    CFD-Post writes a section [Data] per plane, and others that are no rows.
    """
    lines, rows, remarks = file.lines, file.rows(first), []
    marks = [n for n in rows if SECTION.fullmatch(lines[n])]
    if not marks:
        return rows, remarks
    taken = [n for n in rows if n < marks[0]]
    head, planes = next(n for n in reversed(file.rows(0)) if n < first), 1
    for start, end in pairwise([*marks, len(lines)]):
        match = SECTION.fullmatch(lines[start])
        if match is None or match[1].strip().lower() != "data":
            continue
        inside = [n for n in rows if start < n < end]
        if not inside or lines[inside[0]].split() != lines[head].split():
            raise file.wrong(start + 1, "a second section [Data] has other columns; split the file")
        taken += inside[1:]
        planes += 1
    if planes > 1:
        remarks.append(f"{planes} sections [Data] are read as one table")
    return taken, remarks


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


def _values(
    table: Table, accepted: Mapping[str, Column], picked: Mapping[str, Picked], missing: Sequence[float]
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the values by key, and remarks on missing ones. Raises ConventionError, and the file's error."""
    dated = [
        key for key, column in picked.items() if accepted[key].unit == "s" and _has_dates(table, column.index)
    ]
    keys = [key for key in picked if not accepted[key].is_text and key not in dated]
    numbers = table.numbers(*(picked[key].index for key in keys)) if keys else np.empty((len(table), 0))
    values, remarks = {}, []
    for key, column in zip(keys, numbers.T, strict=True):
        values[key], more = cleared(column, picked[key], accepted[key], missing)
        remarks += more
    for key, column in picked.items():
        if accepted[key].is_text:
            values[key] = table.texts(column.index)
    for key in dated:
        texts = list(table.texts(picked[key].index))
        if "date" in values and not re.match(r"\d{4}-", str(texts[0])):
            texts = [f"{date}T{text}" for date, text in zip(values["date"], texts, strict=True)]
        values[key] = iso_times(texts)
        wrong = np.flatnonzero(np.isnan(values[key]))
        if len(wrong):
            raise table.wrong(
                int(wrong[0]), "its time is no date such as 2026-01-01T10:00:00.5, nor 10:00:00.5"
            )
    return values, remarks


def _has_dates(table: Table, column: int) -> bool:
    if not len(table):
        return False
    cells = cells_of(table.file.lines[table.rows[0]], table.delimiter)
    return column < len(cells) and not IS_NUMBER.fullmatch(cells[column]) and ":" in cells[column]
