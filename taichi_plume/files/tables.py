"""Text files and tables in them (CSV), read by pyarrow: lines, cells, numbers; errors name the line."""

import csv
import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from taichi_plume.files import manifest
from taichi_plume.guard.opening import read_regular

LARGEST_FILE = 1 << 29  # bytes
LONGEST_HEADER = 1 << 16  # characters
LONGEST_LIST = 400  # of names that are shown
LONGEST_TEXT = 40  # characters shown of what is wrong
LONGEST_REASON = 300  # characters shown of what a library says


def unchanged_content(path: Path, fault: type[ValueError], most: int = LARGEST_FILE) -> bytes:
    """Return the content of a file of at most `most` bytes.

    Raises a `fault` of one line, also if the file differs from the manifest beside it.
    """
    try:
        content = read_regular(path, most)
    except OSError as error:
        raise fault(f"{path}: cannot be read: {error.strerror or error}") from None
    manifest.require_unchanged(path, fault)
    if content is None:
        raise fault(f"{path}: is too large; {most >> 20} MiB are read")
    return content


class TextFile:
    """The lines of a text file, without empty lines at the end.

    Errors are raised as `fault`; the message is one line and begins with the path.
    """

    def __init__(self, path: Path, fault: type[ValueError]):
        self.path, self.fault = path, fault
        content = unchanged_content(path, fault)
        try:
            self.lines = content.decode("utf-8-sig").splitlines()
        except UnicodeDecodeError as error:
            line = content.count(b"\n", 0, error.start) + 1
            raise self.wrong(line, "is not plain text (UTF-8)") from None
        while self.lines and not self.lines[-1].strip():
            self.lines.pop()
        if not self.lines:
            raise fault(f"{path}: is empty")

    def rows(self, first: int) -> list[int]:
        """Return the indices of the lines from `first` on that hold more than a comment."""
        return [n for n in range(first, len(self.lines)) if self.lines[n].strip()[:1] not in ("", "#")]

    def wrong(self, line: int, what: str) -> ValueError:
        """Return the error of a line, counted from 1."""
        return self.fault(f"{self.path}: line {line}: {what}")


@dataclass(frozen=True)
class Table:
    """Rows of a text file, the lines of these indices, each of `width` cells.

    delimiter: between cells, None: blanks. form: expected form of a row, for messages; by default messages show the
    cell. gaps: cells may be empty or say NA, null and the like.
    """

    file: TextFile
    rows: Sequence[int]
    width: int
    delimiter: str | None = ","
    form: str = ""
    gaps: bool = False

    def __len__(self) -> int:
        return len(self.rows)

    def numbers(self, *columns: int) -> np.ndarray:
        """Return columns as floats, (rows, columns), NaN in gaps."""
        return np.stack(self._read(columns, "float64"), axis=-1)

    def texts(self, column: int) -> np.ndarray:
        """Return a column as text, (rows,); None in gaps."""
        return self._read([column], "string")[0]

    def _read(self, columns: Sequence[int], kind: str) -> list[np.ndarray]:
        import pyarrow as pa
        import pyarrow.csv

        if not len(self):
            return [np.empty(0) for _ in columns]
        lines, delimiter = [self.file.lines[row] for row in self.rows], self.delimiter
        if delimiter is None:
            lines, delimiter = [" ".join(line.split()) for line in lines], " "
        names = [str(n) for n in range(self.width)]
        convert = pa.csv.ConvertOptions(strings_can_be_null=self.gaps)
        convert.include_columns = [names[n] for n in columns]
        convert.column_types = dict.fromkeys(convert.include_columns, pa.type_for_alias(kind))
        if not self.gaps:
            convert.null_values = []
        try:
            table = pa.csv.read_csv(
                pa.BufferReader("\n".join([*lines, ""]).encode()),
                pa.csv.ReadOptions(column_names=names, use_threads=False),  # with threads errors name no row
                pa.csv.ParseOptions(delimiter=delimiter, ignore_empty_lines=False),
                convert,
            )
        except pa.ArrowInvalid as error:
            raise self._unread(str(error).partition("\n")[0]) from None
        if table.num_rows != len(lines):  # a quotation mark took in lines
            self.refuse(['"' in line for line in lines], lambda _: "a quotation mark is not closed")
        return [column.to_numpy() for column in table.columns]

    def _unread(self, reason: str) -> ValueError:
        """Return the error for a message of pyarrow."""
        match = re.search(
            r"Row #(\d+): (?:Expected (\d+) columns, got (\d+)|.*invalid value '(.*?)'?$)", reason
        )
        if not match:
            return self.file.fault(f"{self.file.path}: cannot be read: {plain(reason)}")
        row = int(match[1]) - 1
        if self.form:
            return self.wrong(row, f"must be {self.form}, got {self.shown(row)}")
        if match[2]:
            return self.wrong(row, f"has {match[3]} columns, not {match[2]}; is the file whole?")
        return self.wrong(row, f"{shown(match[4])} is no number")

    def wrong(self, row: int, what: str) -> ValueError:
        """Return the error of a row, counted from 0."""
        return self.file.wrong(self.rows[row] + 1, what)

    def shown(self, row: int) -> str:
        """Return a row for a message."""
        return shown(self.file.lines[self.rows[row]])

    def refuse(self, faulty: ArrayLike, what: Callable[[int], str]) -> None:
        """Raise the error of the first faulty row, if any; faulty: (rows,); what: message of a row."""
        if np.any(faulty):
            first = int(np.argmax(faulty))
            raise self.wrong(first, what(first))


def cells_of(line: str, delimiter: str | None) -> list[str]:
    """Return the cells of a line, without quotation marks and blanks around; delimiter: None for blanks."""
    if delimiter is None:
        line, delimiter = " ".join(line.split()), " "
    reader = csv.reader([line[:LONGEST_HEADER]], delimiter=delimiter, skipinitialspace=True)
    return [cell.strip() for cell in next(reader)]


def delimiter_of(line: str) -> str | None:
    """Return the delimiter of a line: comma, semicolon or tab; None for blanks."""
    return max((mark for mark in ",;\t" if mark in line), key=line.count, default=None)


def is_number(text: str) -> bool:
    """Return whether a text is a number, finite or not."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def plain(reason: str) -> str:
    """Return the first line of a library's message, cut to LONGEST_REASON."""
    line = reason.strip().partition("\n")[0]
    return line if len(line) <= LONGEST_REASON else f"{line[: LONGEST_REASON - 3]}..."


def listed(names: Sequence[str]) -> str:
    """Join names for a message."""
    text = ", ".join(name[:LONGEST_TEXT] for name in names)
    return textwrap.shorten(text, LONGEST_LIST, placeholder=" ...")


def shown(text: str) -> str:
    """Quote and cut a text for a message."""
    return repr(text if len(text) <= LONGEST_TEXT else text[: LONGEST_TEXT - 3] + "...")
