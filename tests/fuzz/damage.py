"""Damage done to files: bits, blocks, lines, numbers, columns; and to folders of files."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.values import MARKS, NUMBER_TEXTS

REPEATED = 100_000  # bytes


class Damage:
    """Damages files by chance."""

    def __init__(self, rng: np.random.Generator):
        self.rng = rng

    def _one(self, items: Any) -> Any:
        return items[int(self.rng.integers(len(items)))]

    def _cuts(self, size: int, count: int) -> list[int]:
        return sorted(int(n) for n in self.rng.integers(0, size + 1, count))

    def damaged(self, content: bytes, text: bool) -> bytes:
        """The content with one damage or more; text: of the kinds that text suffers too."""
        for _ in range(int(self.rng.geometric(0.7))):
            if text and self.rng.random() < 0.7:
                content = self._one(TEXT)(self, content.decode("utf-8", "surrogateescape")).encode(
                    "utf-8", "surrogatepass" if self.rng.random() < 0.1 else "replace"
                )
            else:
                content = self._one(BINARY)(self, content)
        return content

    # ------------------------------------------------------------ of any file

    def _flip(self, content: bytes) -> bytes:
        bits = bytearray(content)
        for _ in range(int(self.rng.geometric(0.4)) if bits else 0):
            bits[int(self.rng.integers(len(bits)))] ^= 1 << int(self.rng.integers(8))
        return bytes(bits)

    def _flip_late(self, content: bytes) -> bytes:
        """Near the end, where some formats have what tells of all else."""
        cut = max(0, len(content) - 2000)
        return content[:cut] + self._flip(content[cut:])

    def _cut(self, content: bytes) -> bytes:
        at = self._cuts(len(content), 1)[0]
        return content[:at] if self.rng.random() < 0.8 else content[at:]

    def _delete(self, content: bytes) -> bytes:
        a, b = self._cuts(len(content), 2)
        return content[:a] + content[min(b, a + int(self.rng.integers(1, 600))) :]

    def _duplicate(self, content: bytes) -> bytes:
        a, b = self._cuts(len(content), 2)
        return content[:b] + content[a:b] + content[b:]

    def _overwrite(self, content: bytes) -> bytes:
        a, b = self._cuts(len(content), 2)
        b = min(b, a + int(self.rng.integers(1, 600)))
        filler = b"\0" * (b - a) if self.rng.random() < 0.5 else self.rng.bytes(b - a)
        return content[:a] + filler + content[b:]

    def _exchange(self, content: bytes) -> bytes:
        a, b, c = self._cuts(len(content), 3)
        return content[:a] + content[b:c] + content[a:b] + content[c:]

    def _nothing(self, content: bytes) -> bytes:
        return self._one(
            [b"", b"\0" * len(content), b"\n", self.rng.bytes(500), content[:4], content + self.rng.bytes(99)]
        )

    def _repeat(self, content: bytes) -> bytes:
        """A piece, a line or a line end so often that quadratic time shows."""
        a = self._cuts(len(content), 1)[0]
        line = content[a:].partition(b"\n")[0] + b"\n"
        piece = self._one(
            [b"\n", b" ", b"[", b"{", b"- ", line, content[a : a + int(self.rng.integers(1, 9))]]
        )
        return content[:a] + piece * (REPEATED // max(1, len(piece))) + content[a:]

    # ------------------------------------------------------------ of text

    def _number(self, text: str) -> str:
        numbers = list(re.finditer(r"[-+]?[\d.]+(e[-+]?\d+)?", text[:200_000]))
        if not numbers:
            return text
        number = self._one(numbers[:40] if self.rng.random() < 0.3 else numbers)
        return text[: number.start()] + self._one(NUMBER_TEXTS) + text[number.end() :]

    def _mark(self, text: str) -> str:
        at = self._cuts(len(text), 1)[0]
        return text[:at] + self._one(MARKS) + text[at:]

    def _line(self, text: str) -> str:
        lines = text.splitlines(keepends=True) or [""]
        a, b = (int(n) for n in self.rng.integers(0, len(lines), 2))
        if self.rng.random() < 0.3:
            a = 0
        what = self.rng.integers(4)
        if what == 0:
            del lines[a]
        elif what == 1:
            lines.insert(b, lines[a])
        elif what == 2:
            lines[a], lines[b] = lines[b], lines[a]
        else:
            lines[a] = lines[a].rstrip("\n") + lines[b]
        return "".join(lines)

    def _column(self, text: str) -> str:
        """Two columns change places, in all lines or in one; or one goes, or comes twice."""
        lines = text.split("\n")
        mark = self._one([",", " ", ";", "\t"]) if self.rng.random() < 0.1 else ("," if "," in text else None)
        chosen = range(len(lines)) if self.rng.random() < 0.7 else [int(self.rng.integers(len(lines)))]
        a, b, what = int(self.rng.integers(6)), int(self.rng.integers(6)), self.rng.integers(3)
        for n in chosen:
            cells = lines[n].split(mark)
            if len(cells) > max(a, b):
                if what == 0:
                    cells[a], cells[b] = cells[b], cells[a]
                elif what == 1:
                    del cells[a]
                else:
                    cells.insert(a, cells[b])
                lines[n] = (mark or " ").join(cells)
        return "\n".join(lines)

    def _sign(self, text: str) -> str:
        old, new = self._one([(",", ";"), (".", ","), (",", "\t"), ("\n", "\r\n"), ("\n", "\r"), (" ", ""), (",", ",,"),
                              ("\n", "\n\n"), ("0", "1"), ("-", ""), ("\n", ""), ("+", "")])  # fmt: skip
        return text.replace(old, new)

    # ------------------------------------------------------------ of folders

    def folder(self, path: Path) -> None:
        """Damage a folder of files: one of them, or what there is of them."""
        files = sorted(file for file in path.rglob("*") if file.is_file())
        reported = [file for file in files if file.suffix == ".json"]
        file = self._one(reported if reported and self.rng.random() < 0.5 else files)
        what = self.rng.random()
        if what < 0.8:
            file.write_bytes(self.damaged(file.read_bytes(), file.suffix == ".json"))
        elif what < 0.87:
            file.unlink()
        elif what < 0.92:
            folders = [one for one in path.rglob("*") if one.is_dir()]
            shutil.rmtree(self._one(folders))
        elif what < 0.95:
            file.unlink()
            file.mkdir()
        elif what < 0.98:
            target = file.with_name(self._one(["0", "1", "9", "zarr.json", "u", "x" * 200]))
            if not target.is_dir():
                file.rename(target)
        else:
            shutil.copytree(file.parent, path / "zz" / "c", dirs_exist_ok=True)


BINARY: list[Callable[[Damage, bytes], bytes]] = [
    Damage._flip,
    Damage._flip,
    Damage._flip_late,
    Damage._cut,
    Damage._delete,
    Damage._duplicate,
    Damage._overwrite,
    Damage._exchange,
    Damage._nothing,
    Damage._repeat,
]
TEXT: list[Callable[[Damage, str], str]] = [
    Damage._number,
    Damage._number,
    Damage._number,
    Damage._mark,
    Damage._line,
    Damage._column,
    Damage._sign,
]
