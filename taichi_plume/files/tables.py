"""Text files and the tables in them, read by pyarrow: lines, cells, numbers, and the line that is at fault."""

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


class TextFile:
    """The lines of a text file, without empty ones at its end.

    Whatever is wrong with it is raised as a `fault`, whose message is one line and begins with the path.
    """

    def __init__(self, path: Path, fault: type[ValueError]):
        self.path, self.fault = path, fault
        try:
            content = read_regular(path, LARGEST_FILE)
        except OSError as error:
            raise fault(f"{path}: cannot be read: {error.strerror or error}") from None
        damage = manifest.changed(path)
        if damage:
            raise fault(damage)
        if content is None:
            raise fault(f"{path}: is too large; {LARGEST_FILE >> 20} MiB are read")
        try:
            self.lines = content.decode("utf-8-sig").splitlines()
        except UnicodeDecodeError as error:
            line = content.count(b"\n", 0, error.start) + 1
            raise self.wrong(line, "is not plain text (UTF-8)") from None
        while self.lines and not self.lines[-1].strip():
            self.lines.pop()
        if not self.lines:
            raise fault(f"{path}: is empty")

    def told(self, first: int) -> list[int]:
        """Indices of the lines from `first` on that hold more than a comment."""
        return [n for n in range(first, len(self.lines)) if self.lines[n].strip()[:1] not in ("", "#")]

    def wrong(self, line: int, what: str) -> ValueError:
        """The fault of a line, counted from 1."""
        return self.fault(f"{self.path}: line {line}: {what}")


@dataclass(frozen=True)
class Table:
    """Rows of a text file, the lines of these indices, each of `width` cells.

    delimiter: what parts cells, None: blanks. form: what a row that cannot be read is told to have to be; unless given,
    its cell is told. gaps: whether cells may be empty or say NA, null and the like.
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
        """Some of the columns as floats, (rows, columns), NaN in gaps."""
        return np.stack(self._read(columns, "float64"), axis=-1)

    def texts(self, column: int) -> np.ndarray:
        """A column as it stands there, (rows,); None in gaps."""
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
                pa.csv.ReadOptions(
                    column_names=names, use_threads=False
                ),  # threads do not tell rows at fault
                pa.csv.ParseOptions(delimiter=delimiter, ignore_empty_lines=False),
                convert,
            )
        except pa.ArrowInvalid as error:
            raise self._unread(str(error).partition("\n")[0]) from None
        if table.num_rows != len(lines):  # a quotation mark took in lines
            self.refuse(['"' in line for line in lines], lambda _: "a quotation mark lacks its other")
        return [column.to_numpy() for column in table.columns]

    def _unread(self, reason: str) -> ValueError:
        """The fault that pyarrow tells so."""
        told = re.search(
            r"Row #(\d+): (?:Expected (\d+) columns, got (\d+)|.*invalid value '(.*?)'?$)", reason
        )
        if not told:
            return self.file.fault(f"{self.file.path}: cannot be read: {plain(reason)}")
        row = int(told[1]) - 1
        if self.form:
            return self.wrong(row, f"must be {self.form}, got {self.shown(row)}")
        if told[2]:
            return self.wrong(row, f"has {told[3]} columns, not {told[2]}; is the file whole?")
        return self.wrong(row, f"{shown(told[4])} is no number")

    def wrong(self, row: int, what: str) -> ValueError:
        """The fault of a row, counted from 0."""
        return self.file.wrong(self.rows[row] + 1, what)

    def shown(self, row: int) -> str:
        """A row as it is shown in a message."""
        return shown(self.file.lines[self.rows[row]])

    def refuse(self, faulty: ArrayLike, what: Callable[[int], str]) -> None:
        """Raise the fault of the first row that is faulty, (rows,), if there is one; what: said of the row."""
        if np.any(faulty):
            first = int(np.argmax(faulty))
            raise self.wrong(first, what(first))


def cells_of(line: str, delimiter: str | None) -> list[str]:
    """The cells of a line, without quotation marks and blanks around them; delimiter: None: blanks."""
    if delimiter is None:
        line, delimiter = " ".join(line.split()), " "
    reader = csv.reader([line[:LONGEST_HEADER]], delimiter=delimiter, skipinitialspace=True)
    return [cell.strip() for cell in next(reader)]


def delimiter_of(line: str) -> str | None:
    """What parts the cells of a line; None: blanks."""
    return max((mark for mark in ",;\t" if mark in line), key=line.count, default=None)


def is_number(text: str) -> bool:
    """Whether a cell is one, finite or not."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def plain(reason: str) -> str:
    """The first line of what a library says, no longer than a message may be."""
    line = reason.strip().partition("\n")[0]
    return line if len(line) <= LONGEST_REASON else f"{line[: LONGEST_REASON - 3]}..."


def listed(names: Sequence[str]) -> str:
    """Names of columns as they are shown in a message."""
    return textwrap.shorten(
        ", ".join(name[:LONGEST_TEXT] for name in names), LONGEST_LIST, placeholder=" ..."
    )


def shown(text: str) -> str:
    """A text as it is shown in a message."""
    return repr(text if len(text) <= LONGEST_TEXT else text[: LONGEST_TEXT - 3] + "...")
