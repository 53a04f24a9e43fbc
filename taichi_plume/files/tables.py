"""Parser of text files and tables in them (CSV), by pyarrow: lines, cells, numbers; errors name the line."""

import csv
import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from taichi_plume.files import manifest
from taichi_plume.guard.safe_open import content_of, encoding_of

NONE = ("-", "--", "None", "none", "undef", "undefined")  # in cells without a value, besides Arrow's
FORTRAN = re.compile(r"(?<=\d)[dD](?=[-+]\d)|(?<=\d\.)[dD](?=[-+]\d)")  # 1.0D+00
LARGEST_FILE = 1 << 29  # bytes
CONTROL = re.compile("[\0-\x08\x0e-\x1f\x7f]")  # no text has them
LONGEST_HEADER = 1 << 16  # characters
LONGEST_LIST = 400  # of names that are shown
LONGEST_TEXT = 40  # characters shown of what is wrong
LONGEST_REASON = 300  # characters shown of what a library says


class TextFile:
    """Lines of a text file in UTF-8, UTF-16 or Latin-1, without empty lines at the end.

    Errors are raised as `fault`; the message is one line and begins with the path. remarks: what was assumed.
    """

    def __init__(self, path: Path, fault: type[ValueError]):
        self.path, self.fault = path, fault
        content = content_of(path, LARGEST_FILE, fault)
        manifest.require_unchanged(path, fault)
        self.remarks: tuple[str, ...] = ()
        try:
            text = content.decode(encoding_of(content))
        except UnicodeDecodeError:
            text = content.decode("latin-1")
            self.remarks = ("is not UTF-8; it was read as Latin-1",)
        binary = CONTROL.search(text)
        if binary:
            raise self.wrong(text.count("\n", 0, binary.start()) + 1, "is not plain text")
        self.lines = text.splitlines()
        while self.lines and not self.lines[-1].strip():
            self.lines.pop()
        if not self.lines:
            raise fault(f"{path}: is empty")

    def rows(self, first: int) -> list[int]:
        """Return the indices, from `first` on, of the lines that are neither empty nor only a comment."""
        return [n for n in range(first, len(self.lines)) if self.lines[n].strip()[:1] not in ("", "#", "%")]

    def wrong(self, line: int, what: str) -> ValueError:
        """Return an error that names a line of the file, counted from 1."""
        return self.fault(f"{self.path}: line {line}: {what}")


@dataclass(frozen=True)
class Table:
    """Table in a text file: rows are the lines of these indices, with `width` cells each.

    delimiter: between cells, None: blanks; decimal: mark of decimals. form: expected form of a row, for messages; by
    default messages show the cell. gaps: cells may be empty or say NA, null and the like.
    """

    file: TextFile
    rows: Sequence[int]
    width: int
    delimiter: str | None = ","
    form: str = ""
    gaps: bool = False
    decimal: str = "."

    def __len__(self) -> int:
        return len(self.rows)

    def numbers(self, *columns: int) -> np.ndarray:
        """Return these columns of the table as floats, (rows, columns), NaN in empty cells."""
        return np.stack(self._read(columns, "float64"), axis=-1)

    def texts(self, column: int) -> np.ndarray:
        """Return a column of the table as text, (rows,); None in empty cells."""
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
        convert = pa.csv.ConvertOptions(strings_can_be_null=self.gaps, decimal_point=self.decimal)
        convert.include_columns = [names[n] for n in columns]
        convert.column_types = dict.fromkeys(convert.include_columns, pa.type_for_alias(kind))
        convert.null_values = [*convert.null_values, *NONE] if self.gaps else []
        try:
            table = pa.csv.read_csv(
                pa.BufferReader(FORTRAN.sub("e", "\n".join([*lines, ""])).encode()),
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
        """Return an error that names the line, made from a message of pyarrow's CSV reader."""
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
        """Return an error that names the line of a table row, counted from 0."""
        return self.file.wrong(self.rows[row] + 1, what)

    def shown(self, row: int) -> str:
        """Return a row of the table as quoted text for a message."""
        return shown(self.file.lines[self.rows[row]])

    def refuse(self, faulty: ArrayLike, what: Callable[[int], str]) -> None:
        """Raise an error on the first faulty row, if any; faulty: (rows,); what: function that gives the message."""
        if np.any(faulty):
            first = int(np.argmax(faulty))
            raise self.wrong(first, what(first))


def cells_of(line: str, delimiter: str | None) -> list[str]:
    """Split a line into cells, without quotation marks and surrounding blanks; delimiter: None for blanks."""
    if delimiter is None:
        line, delimiter = " ".join(line.split()), " "
    reader = csv.reader([line[:LONGEST_HEADER]], delimiter=delimiter, skipinitialspace=True)
    return [cell.strip() for cell in next(reader)]


def delimiter_of(line: str) -> str | None:
    """Return the most frequent delimiter of a line: comma, semicolon or tab; None (blanks) without these."""
    return max((mark for mark in ",;\t" if mark in line), key=line.count, default=None)


def is_number(text: str) -> bool:
    """Return whether a text can be read as a float, including nan and inf."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def plain(reason: str) -> str:
    """Return the first line of a library's error message, cut to LONGEST_REASON characters."""
    line = reason.strip().partition("\n")[0]
    return line if len(line) <= LONGEST_REASON else f"{line[: LONGEST_REASON - 3]}..."


def listed(names: Sequence[str]) -> str:
    """Join names by commas for a message, cut to a limited length."""
    text = ", ".join(name[:LONGEST_TEXT] for name in names)
    return textwrap.shorten(text, LONGEST_LIST, placeholder=" ...")


def shown(text: str) -> str:
    """Quote a text for a message, cut to a limited length."""
    return repr(text if len(text) <= LONGEST_TEXT else text[: LONGEST_TEXT - 3] + "...")
