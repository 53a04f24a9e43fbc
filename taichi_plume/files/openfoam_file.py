"""Parser of OpenFOAM files: header, lists of numbers and faces, internal fields, dictionaries; text, binary or gzipped.

Macros ($name) and #include of files in the case are resolved in dictionaries and in uniform fields. Other directives
(#calc, #codeStream, #if) are recognised, not executed.
"""

import codecs
import gzip
import os
import re
import warnings
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.files.conventions import factor_of
from taichi_plume.files.wind_points import WindFileError
from taichi_plume.guard.safe_open import content_of, encoding_of, inside, open_regular

LARGEST_FILE = 1 << 30  # bytes
LARGEST_LABEL = 2.0**31
MOST_EQUAL = 1000  # entries of a list with one value for all, if their number is not known otherwise
# Every pattern reads each byte a bounded number of times: an unclosed comment reaches to the end of the file, and there
# is no backtracking over blanks (++).
COMMENT = re.compile(rb"/(?:/[^\n]*|\*.*?(?:\*/|\Z))", re.DOTALL)
SKIPPED = re.compile(rb"\s++|//[^\n]*+|/\*.*?(?:\*/|\Z)", re.DOTALL)
HEADER = re.compile(rb"FoamFile\s*+\{([^{}]*+)\}")
ENTRY = re.compile(rb'(\w++)\s++("[^"]*+"|[^\s;"]++)\s*+;')  # key value;
LIST = re.compile(rb"\s*+(\d{1,10})\s*+([({])")
ENDS = {True: re.compile(rb"\)\s*\)"), False: re.compile(rb"\)")}  # of a list of lists, of one of numbers
EQUAL_END = re.compile(rb"\}")
FACE = re.compile(
    rb"(\d{1,9}+)\s*+\("
)  # the number of entries and the start of a list, or of the vertices of a face
BLANK = bytes.maketrans(b"()", b"  ")
NONE = re.compile(rb"\s*+0(?!\d|\.|\s*+[({])")  # a list without entries, as binary files have it
DIMENSIONS = re.compile(rb"\bdimensions\s++\[([^\]\n]{0,200})\]")
MACRO = re.compile(
    rb"internalField\s++(?:(?:non)?uniform\b\s*+)?(?:List<\w++>\s*+)?(?:\([^;()]{0,300}?)?([#$]\{?\w*)"
)
START = 1 << 16  # bytes of a field in which its internalField begins
LARGEST_DICTIONARY = 1 << 22
LONGEST_CHAIN = 10  # files that include one another
CODE = re.compile(r"#\{.*?(?:#\}|\Z)", re.DOTALL)
TOKEN = re.compile(r'#\w++[ \t]*+(?:"[^"\n]*+"|[^\n{};]*+)|"[^"\n]*+"|[{};]|(?:\$\{[^\s{};]*+\}|[^\s{};"])++')
INCLUDE = re.compile(r'#(?:include|includeIfPresent|sinclude)\s*+"?([^"]++)"?')
FOLDER = re.compile(r"\$FOAM_CASE|\$\{FOAM_CASE\}|<case>|<(system|constant)>")
NAME = re.compile(r"\$(?:\{[^{}]*+\}|[\w.:/]++)")  # a macro
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
        macro, uniform = macro_of(self.body), inner[1] if inner else None
        if macro:
            uniform = _resolved_field(self.path).encode()
            if not uniform:
                raise self.wrong(f"its internalField is a macro of OpenFOAM ({macro}), which is not resolved")
        elif inner is None:
            raise self.wrong("has no internalField")
        if uniform is None:
            return self.numbers(width, inner.end(), cells)
        unit = UNIT.search(uniform)
        factor = _factor(unit[1], "m/s" if width == 3 else "m^2/s") if unit else 1.0
        values = _numbers(UNIT.sub(b" ", uniform))
        if factor is None or values is None or len(values) != width or not np.isfinite(values).all():
            raise self.wrong(
                f"its internalField must be {width} numbers, in {'m/s' if width == 3 else 'm^2/s'}"
            )
        return np.tile(factor * values, (cells, 1))

    def require_dimensions(self, unit: str, quantity: str) -> bool:
        """Raise WindFileError if the field states other dimensions than those of `unit`; False without a statement.

        unit: "m/s" or "m^2/s"; quantity: noun for the message.
        """
        stated = DIMENSIONS.search(self.body)
        if stated is None:
            return False
        if _factor(stated[1], unit) != 1.0:
            text, expected = stated[1].decode("ascii", "replace").strip(), EXPONENTS[unit]
            whole = " ".join(map(str, (*expected, 0, 0)))
            raise self.wrong(f"its dimensions [{text}] are not those of {quantity}, [{whole}] ({unit})")
        return True

    def labels(self) -> np.ndarray:
        """Return a list of integers (labels of OpenFOAM), such as the owner cells of faces."""
        return self._labels(self._list(0, self.label, 1)[0])

    def _labels(self, values: np.ndarray | None) -> np.ndarray:
        if values is None or not (np.abs(values) < LARGEST_LABEL).all():
            raise self.wrong("its list holds what is no label of a mesh")
        return values.astype(np.int64)

    def faces(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the vertices of all mesh faces, concatenated, and for each face the index of its end in them."""
        if self.binary and self.kind != "faceCompactList":
            raise self.wrong("is a binary list of another class than faceCompactList")
        if self.kind == "faceCompactList":
            ends, end = self._list(0, self.label, 1)
            ends, flat = self._labels(ends)[1:], self._labels(self._list(end, self.label, 1)[0])
            count = len(ends)
        else:
            body = b"0(" if NONE.match(self.body) else self.body
            if not FACE.match(body.lstrip()):
                raise self.wrong("has no list")
            count, *sizes = map(int, FACE.findall(body))
            ends, flat = np.cumsum(sizes, dtype=np.int64), self._labels(_numbers(FACE.sub(b" ", body)))
        if not count and not len(flat):
            return flat, ends
        if len(ends) != count or (np.diff(ends, prepend=0) < 3).any() or ends[-1] != len(flat):
            raise self.wrong("the list of faces is truncated or damaged")
        return flat, ends

    def _list(
        self, begin: int, kind: np.dtype, width: int, required: int | None = None
    ) -> tuple[np.ndarray, int]:
        """Return the values of the list at position `begin`, and the position after it; required: expected length."""
        empty, head = NONE.match(self.body, begin), LIST.match(self.body, begin)
        if not empty and head is None:
            raise self.wrong("has no list")
        count = int(head[1]) if head else 0
        if required is not None and count != required:
            raise self.wrong(f"has {count} values, but the mesh has {required} cells")
        if empty or head is None:
            return np.empty(0, kind), empty.end() if empty else begin
        is_equal, start = head[2] == b"{", head.end()  # one value for all
        if is_equal and required is None and count > MOST_EQUAL:
            raise self.wrong(f"its list of {count} equal entries is too long to be that of a mesh")
        number, close = (width, b"}") if is_equal else (count * width, b")")
        if self.binary:
            end = start + number * kind.itemsize
            is_whole = self.body[end : end + 1] == close
            values = np.frombuffer(self.body, kind, number, start) if is_whole else np.empty(0)
        else:
            match = (EQUAL_END if is_equal else ENDS[width > 1 and count > 0]).search(self.body, start)
            end = match.end() - 1 if match else len(self.body)
            values = _numbers(self.body[start:end])
        if values is None:
            raise self.wrong("its list holds what is no number")
        if self.body[end : end + 1] != close or len(values) != number:
            found = f"{len(values) / width:.6g} of {1 if is_equal else count}"
            raise self.wrong(f"its list has {found} entries; is it whole?")
        return np.tile(values, count) if is_equal else values, end + 1


EXPONENTS = {"m/s": (0, 1, -1, 0, 0), "m^2/s": (0, 2, -1, 0, 0)}
"""Exponents of kg, m, s, K and mol."""
UNIT = re.compile(rb"\[([^\]]{0,200})\]")
NAMED_DIMENSIONS = {"velocity": "m/s", "kinematicViscosity": "m^2/s", "viscosity": "m^2/s"}
"""Names of dimension sets in recent versions of OpenFOAM."""


def _factor(written: bytes, unit: str) -> float | None:
    """Return the factor to "m/s" or "m^2/s" of dimensions or a unit in an OpenFOAM file; None if they differ."""
    text, exponents = written.decode("ascii", "replace").strip(), _numbers(written)
    if exponents is not None:
        fits = (
            len(exponents) in (5, 7) and not exponents[5:].any() and tuple(exponents[:5]) == EXPONENTS[unit]
        )
        return 1.0 if fits else None
    if NAMED_DIMENSIONS.get(text) == unit:
        return 1.0
    return factor_of(text, unit)


def macro_of(body: bytes) -> str:
    """Return the macro or directive that stands for the internalField of a field, such as "$U0"; "" without one."""
    macro, plain = MACRO.search(body), FIELD.search(body)
    if macro and (plain is None or macro.start() <= plain.start()):
        return macro[1].decode("ascii", "replace")
    return (
        "#include"
        if b"#include" in body and b"internalField" not in body.replace(b"$internalField", b"")
        else ""
    )


def unresolved_macro(path: Path) -> str:
    """Return the macro that stands for the internalField of a file; "" if none does, or if its value is known.

    Reads only the start of a file without a macro. Raises WindFileError.
    """
    path = real_path(path)
    try:
        with open_regular(path) as file:
            start = file.read(START)
    except OSError as error:
        raise WindFileError(f"{path}: cannot be read: {error.strerror or error}") from None
    if start[:2] == b"\x1f\x8b":
        try:
            start = zlib.decompressobj(31).decompress(start, START)
        except zlib.error:
            return ""  # `open_foam` reports it
    is_whole = b"internalField" in start or len(start) < START
    macro = macro_of(COMMENT.sub(b"", start)) if is_whole else ""
    return "" if macro and _resolved_field(path) else macro


def _resolved_field(path: Path) -> str:
    """Return the values of a uniform internalField that macros state, as text; "" if they cannot be resolved."""
    try:
        kind, _, values = str(dictionary(path).get("internalField", "")).partition(" ")
    except WindFileError:
        return ""
    return values if kind == "uniform" and not {"$", "#"} & set(values) else ""


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
    path, content = _content(path, LARGEST_FILE)
    header = HEADER.match(content, _after_comments(content, 0))
    if header is None:
        raise WindFileError(f"{path}: is no file of OpenFOAM: it does not begin with FoamFile")
    keys = dict(re.findall(ENTRY, COMMENT.sub(b"", header[1])))
    arch, kind = (keys.get(key, b"").decode("ascii", "replace").strip('"') for key in (b"arch", b"class"))
    order = ">" if "MSB" in arch else "<"
    label, scalar = (re.search(rf"{name}=(\d+)", arch) for name in ("label", "scalar"))
    sizes = {"32": 4, "64": 8}
    kinds = [
        np.dtype(f"{order}{letter}{sizes.get(match[1] if match else default, 8)}")
        for letter, match, default in (("i", label, "32"), ("f", scalar, "64"))
    ]
    binary = keys.get(b"format") == b"binary"
    body = content[_after_comments(content, header.end()) :]
    body = body if binary else COMMENT.sub(b"", body)
    return FoamFile(path, body, binary, kinds[0], kinds[1], kind)


def dictionary(path: Path) -> dict[str, Any]:
    """Return the entries of an OpenFOAM dictionary, nested: text of a value, or a dict. Raises WindFileError.

    Macros and #include are resolved. What cannot be resolved stays as text in a value, or is the entry "#" where it
    stands for entries.
    """
    parser = _Parser(path)
    parser.read(path)
    return parser.scopes[0]


class _Parser:
    """Parser of an OpenFOAM dictionary. scopes: the dictionaries around the entry that is read, outermost first."""

    def __init__(self, path: Path):
        self.scopes: list[dict[str, Any]] = [{}]
        self.case = next((folder for folder in path.parents if (folder / "system").is_dir()), path.parent)

    def read(self, path: Path, chain: int = 1) -> None:
        """Add the entries of a file to the innermost scope; chain: number of files that include one another."""
        content = COMMENT.sub(b"", _content(path, LARGEST_DICTIONARY)[1])
        words: list[str] = []
        for token in TOKEN.findall(CODE.sub("", content.decode("utf-8", "replace"))):
            if token[0] == "#" and not words:
                self._include(path, token.strip(), chain)
            elif token == "{":
                key = " ".join(words).strip('"')
                inner = self.scopes[-1].get(key)
                inner = self.scopes[-1][key] = inner if isinstance(inner, dict) else {}
                self.scopes.append(inner)
            elif token == "}":
                self.scopes = self.scopes[:-1] or self.scopes
            elif token == ";":
                self._add(words)
            else:
                words.append(token)
                continue
            words = []

    def _include(self, path: Path, directive: str, chain: int) -> None:
        """Read the file that a directive of the file `path` includes, if it is in the case; else keep the directive."""
        match = INCLUDE.fullmatch(directive)
        name = FOLDER.sub(lambda tag: f"{self.case}/{tag[1] or ''}", match[1] if match else "")
        file = path.parent / self._text(name)
        if match and chain < LONGEST_CHAIN and inside(file, self.case) and exists(file):
            self.read(file, chain + 1)
        elif not directive.startswith(("#includeIfPresent", "#sinclude")):
            self.scopes[-1]["#"] = directive

    def _add(self, words: list[str]) -> None:
        """Add the entry of these words, `key value ...` or a macro of entries, to the innermost scope."""
        whole = self._value(words[-1]) if words and NAME.fullmatch(words[-1]) else None
        if len(words) == 1 and words[0].startswith("$"):
            self.scopes[-1].update(whole if isinstance(whole, dict) else {"#": words[0]})
        elif len(words) == 2 and isinstance(whole, dict):
            self.scopes[-1][words[0].strip('"')] = dict(whole)
        elif len(words) > 1:
            self.scopes[-1][words[0].strip('"')] = self._text(" ".join(words[1:]))

    def _text(self, text: str) -> str:
        """Return a text with the values of its macros; those without a text as value stay."""

        def value(match: re.Match[str]) -> str:
            found = self._value(match[0])
            return found if isinstance(found, str) else match[0]

        return NAME.sub(value, text)

    def _value(self, macro: str) -> str | dict[str, Any] | None:
        """Return the value of a macro such as $a, ${a} or $:a.b in the innermost scope that has it; None without."""
        name = macro.strip("${}").lstrip(":./")
        parts = re.split("[.:/]", name)
        for scope in self.scopes[::-1]:
            value: Any = scope
            for part in [name] if name in scope else parts if parts[0] in scope else ():
                value = value.get(part) if isinstance(value, dict) else None
            if value is not None and value is not scope:
                return value
        return None


def _content(path: Path, most: int) -> tuple[Path, bytes]:
    """Return the real path and the unpacked content of a file, without a byte order mark. Raises WindFileError."""
    path = real_path(path) if exists(path) else path
    content = content_of(path, most, WindFileError)
    if content[:2] == b"\x1f\x8b":
        try:
            content = gzip.decompress(content)
        except (OSError, EOFError, zlib.error) as error:
            raise WindFileError(f"{path}: is cut or damaged: it cannot be unpacked: {error}") from None
    if encoding_of(content) == "utf-16":
        content = content.decode("utf-16", "replace").encode()
    return path, content.removeprefix(codecs.BOM_UTF8)


def _after_comments(content: bytes, at: int) -> int:
    """Return the position after all blanks and comments that begin at position `at`."""
    while skipped := SKIPPED.match(content, at):
        at = skipped.end()
    return at
