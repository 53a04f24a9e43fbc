"""Parser of OpenFOAM files: header, lists of numbers and faces, and internal fields; text, binary or gzipped (.gz)."""

import os
import re
import warnings
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichi_plume.files.wind_points import WindFileError
from taichi_plume.guard.safe_open import content_of

LARGEST_FILE = 1 << 30  # bytes, also once unpacked
UNPACKED = 1 << 26  # bytes that a packed file of any size may have once unpacked
TIGHTEST = 100  # bytes per packed byte of larger files; text of a mesh or field has 3 to 10
LARGEST_LABEL = 2.0**31
MOST_EQUAL = 1000  # entries of a list with one value for all, if their number is not known otherwise
# Every pattern reads each byte a bounded number of times: an unclosed comment reaches to the end of the file, and there
# is no backtracking over blanks (++).
COMMENT = re.compile(rb"/(?:/[^\n]*|\*.*?(?:\*/|\Z))", re.DOTALL)
SKIPPED = re.compile(rb"\s++|//[^\n]*+|/\*.*?(?:\*/|\Z)", re.DOTALL)
HEADER = re.compile(rb"FoamFile\s*+\{([^{}]*+)\}")
WORD = re.compile(rb'"([^"]*)"|(;)|([^\s;"]+)')
LIST = re.compile(rb"\s*+(\d{1,10})\s*+([({])")
ENDS = {True: re.compile(rb"\)\s*\)"), False: re.compile(rb"\)")}  # of a list of lists, of one of numbers
BLANK = bytes.maketrans(b"()", b"  ")
FIELD = re.compile(rb"internalField\s++(?:uniform\s++([^;]{1,300}+);|nonuniform\s++(?:List<\w++>)?)")


@dataclass(frozen=True)
class FoamFile:
    """Content of an OpenFOAM file: the body after the header, and its number format. kind: class in the header."""

    path: Path
    body: bytes
    binary: bool
    label: np.dtype
    scalar: np.dtype
    kind: str

    def wrong(self, what: str) -> WindFileError:
        """Return an error that names this OpenFOAM file; what: the fault."""
        return WindFileError(f"{self.path}: {what}")

    def numbers(self, width: int, begin: int = 0, required: int | None = None) -> np.ndarray:
        """Return a list of scalars or vectors as (n, width), from position `begin`; required: expected n."""
        values = self._list(begin, self.scalar, width, required)[0].astype(float).reshape(-1, width)
        if not np.isfinite(values).all():
            raise self.wrong("not all of its values are finite")
        return values

    def field(self, width: int, cells: int) -> np.ndarray:
        """Return the internalField as an array (cells, width); a uniform field is repeated."""
        inner = FIELD.search(self.body)
        if inner is None:
            raise self.wrong("has no internalField")
        if inner[1] is not None:
            values = _numbers(inner[1])
            if values is None or len(values) != width or not np.isfinite(values).all():
                raise self.wrong(f"its internalField must be {width} numbers")
            return np.tile(values, (cells, 1))
        if not cells and re.compile(rb"\s*+0\s*+;").match(self.body, inner.end()):
            return np.empty((0, width))
        return self.numbers(width, inner.end(), cells)

    def labels(self) -> np.ndarray:
        """Return a list of integers (labels of OpenFOAM), such as the owner cells of faces."""
        values = self._list(0, self.label, 1)[0]
        self._require_labels(values)
        return values.astype(np.int64)

    def _require_labels(self, values: np.ndarray) -> None:
        if not (np.abs(values) < LARGEST_LABEL).all():
            raise self.wrong("its list holds what is no label of a mesh")

    def faces(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the vertices of all mesh faces, concatenated, and for each face the index of its end in them."""
        if self.binary and self.kind != "faceCompactList":
            raise self.wrong("is a binary list of another class than faceCompactList")
        if self.binary or self.kind == "faceCompactList":
            ends, end = self._list(0, self.label, 1)
            flat, _ = self._list(end, self.label, 1)
            ends, flat = ends.astype(np.int64)[1:], flat.astype(np.int64)
        else:
            count, values = self._text(0, True)
            self._require_labels(values)
            sizes, at = [], 0
            for _ in range(count):
                if at >= len(values) or values[at] < 3 or values[at] != int(values[at]):
                    raise self.wrong("the list of faces is truncated or damaged")
                sizes.append(int(values[at]))
                at += sizes[-1] + 1
            heads = np.cumsum([0, *sizes[:-1]]) + np.arange(count)
            ends = np.cumsum(sizes)
            flat = np.delete(values, heads).astype(np.int64) if at == len(values) else np.empty(0, np.int64)
        if not len(ends) or (np.diff(ends, prepend=0) < 3).any() or ends[-1] != len(flat):
            raise self.wrong("the list of faces is truncated or damaged")
        return flat, ends

    def _list(
        self, begin: int, kind: np.dtype, width: int, required: int | None = None
    ) -> tuple[np.ndarray, int]:
        """Return the values of the list at position `begin`, and the position after it; required: expected length."""
        if not self.binary:
            count, values = self._text(begin, width > 1, required)
            if len(values) != count * width:
                raise self.wrong(f"its list has {len(values) / width:.6g} of {count} entries; is it whole?")
            return values, len(self.body)
        head = LIST.match(self.body, begin)
        if head is None:
            raise self.wrong("has no list")
        self._require(int(head[1]), required)
        size = int(head[1]) * width * kind.itemsize
        if head[2] == b"{":  # one value for all
            if len(self.body) <= head.end() + 64 or (required is None and int(head[1]) > MOST_EQUAL):
                raise self.wrong("its list is truncated or damaged")
            value = np.frombuffer(self.body, kind, width, head.end())
            return np.tile(value, int(head[1])), head.end() + width * kind.itemsize + 1
        if self.body[head.end() + size : head.end() + size + 1] != b")":
            raise self.wrong(f"its list of {int(head[1])} entries is cut or damaged")
        return np.frombuffer(self.body, kind, int(head[1]) * width, head.end()), head.end() + size + 1

    def _require(self, count: int, required: int | None) -> None:
        if required is not None and count != required:
            raise self.wrong(f"has {count} values, but the mesh has {required} cells")

    def _text(self, begin: int, nested: bool, required: int | None = None) -> tuple[int, np.ndarray]:
        """Return the stated length of a list in text form, and all numbers in it."""
        head = LIST.match(self.body, begin)
        if head is None or head[2] != b"(":
            raise self.wrong("has no list")
        count = int(head[1])
        self._require(count, required)
        if re.compile(rb"\s*\)").match(self.body, head.end()):
            return count, np.empty(0)
        end = ENDS[nested].search(self.body, head.end())
        if end is None:
            raise self.wrong("its list is cut")
        values = _numbers(self.body[head.end() : end.start()])
        if values is None:
            raise self.wrong("its list holds what is no number")
        return count, values


def _numbers(text: bytes) -> np.ndarray | None:
    """Parse numbers between blanks and parentheses, in linear time; None if the text holds anything else."""
    text = text.translate(BLANK)
    if not text.strip():
        return np.empty(0)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # until NumPy 2.2, in place of the error
        try:
            return np.fromstring(text, sep=" ")
        except (ValueError, DeprecationWarning):
            return None


def exists(path: Path) -> bool:
    """Return whether an OpenFOAM file exists, plain or gzipped (.gz)."""
    return os.path.isfile(path) or os.path.isfile(path.with_name(f"{path.name}.gz"))


def real_path(path: Path) -> Path:
    """Return the path of an OpenFOAM file or, if it does not exist, the path of its gzipped form (.gz)."""
    return path if os.path.isfile(path) else path.with_name(f"{path.name}.gz")


def open_foam(path: Path) -> FoamFile:
    """Read and parse an OpenFOAM file, or its gzipped form if only that exists. Raises WindFileError."""
    path = real_path(path) if exists(path) else path
    content = content_of(path, LARGEST_FILE, WindFileError)
    if content[:2] == b"\x1f\x8b":
        unpacked = zlib.decompressobj(31)
        most = min(LARGEST_FILE, max(UNPACKED, TIGHTEST * len(content)))
        try:
            content = unpacked.decompress(content, most)
        except zlib.error:
            raise WindFileError(f"{path}: is damaged: it cannot be unpacked") from None
        if not unpacked.eof:
            raise WindFileError(f"{path}: is cut, or has more than {most >> 20} MiB once unpacked")
    header = HEADER.match(content, _after_comments(content, 0))
    if header is None:
        raise WindFileError(f"{path}: is no file of OpenFOAM: it does not begin with FoamFile")
    keys = _keys(COMMENT.sub(b"", header[1]))
    arch = keys.get("arch", "")
    order = ">" if "MSB" in arch else "<"
    label, scalar = (re.search(rf"{name}=(\d+)", arch) for name in ("label", "scalar"))
    sizes = {"32": 4, "64": 8}
    kinds = [
        np.dtype(f"{order}{letter}{sizes.get(match[1] if match else default, 8)}")
        for letter, match, default in (("i", label, "32"), ("f", scalar, "64"))
    ]
    binary = keys.get("format") == "binary"
    body = content[_after_comments(content, header.end()) :]
    body = body if binary else COMMENT.sub(b"", body)
    return FoamFile(path, body, binary, kinds[0], kinds[1], keys.get("class", ""))


def _after_comments(content: bytes, at: int) -> int:
    """Return the position after all blanks and comments that begin at position `at`."""
    while skipped := SKIPPED.match(content, at):
        at = skipped.end()
    return at


def _keys(header: bytes) -> dict[str, str]:
    """Return the entries `key value;` of an OpenFOAM header; an entry without semicolon is left out."""
    keys: dict[str, str] = {}
    words: list[str] = []
    for quoted, end, word in WORD.findall(header):
        if not end:
            words.append((quoted or word).decode("ascii", "replace"))
            continue
        if len(words) > 1:
            keys[words[0]] = " ".join(words[1:])
        words = []
    return keys
