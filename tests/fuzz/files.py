"""Damaged files: ``python -m tests.fuzz.files --count 3000 --seed 1 [--formats film yaml]``.

Each has to be read or refused with a line by an error of ours, within 10 s and 2 GiB; where the format has checksums it
is never read as something else.
"""

import argparse
import shutil
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from taichi_plume.files import manifest
from tests.fuzz.damage import Damage
from tests.fuzz.formats import FORMATS, Reader, make
from tests.fuzz.watched import Outcome, Worker, reported

MEMORY = 2 << 30  # bytes that reading may take
LIMIT = 10.0  # s


class Damaging:
    """Damaged files of a seed, made in a folder; those with faults are kept in another.

    listed: whether a run's manifest lies beside its files.
    """

    def __init__(self, folder: Path, seed: int, listed: bool = True, kept: Path | None = None):
        self.whole, self.work, self.seed, self.kept = folder / "whole", folder / "work", seed, kept
        make(self.whole)
        if not listed:
            (self.whole / manifest.NAME).unlink()
        shutil.copytree(self.whole, self.work)
        self.worker = Worker(partial(Reader, self.work), LIMIT, MEMORY)

    def outcomes(self, name: str, numbers: Sequence[int]) -> Iterator[tuple[str, Outcome]]:
        """What came of reading damaged files of a format."""
        kind = FORMATS[name]
        file = self.work / kind.file
        for n in numbers:
            copy(self.whole / kind.file, file)
            self.worker.start()  # the reader begins with whole files
            damage = Damage(np.random.default_rng([self.seed, n, *name.encode()]))
            content = None
            if file.is_dir():
                damage.folder(file)
            else:
                content = damage.damaged(file.read_bytes(), kind.text)
            outcome = self.worker.do((name, content))
            if self.kept and not outcome.good:
                copy(file, self.kept / f"{name}-{self.seed}-{n}{file.suffix}")
            yield f"{name} {n}", outcome
        copy(self.whole / kind.file, file)


def copy(source: Path, target: Path) -> None:
    """Copy a file or folder; an earlier one is replaced."""
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.is_dir():
        shutil.rmtree(target, ignore_errors=True)
        shutil.copytree(source, target)
    else:
        shutil.copyfile(source, target)


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--formats", nargs="*", default=sorted(FORMATS), choices=sorted(FORMATS))
    parser.add_argument("--kept", type=Path, help="where damaged files with faults are kept")
    parser.add_argument(
        "--no-manifest", action="store_true", help="trust the checksums within the files alone"
    )
    args = parser.parse_args()
    folder, bad = Path(mkdtemp()), False
    damaging = Damaging(folder, args.seed, not args.no_manifest, args.kept)
    for name in args.formats:
        found = list(damaging.outcomes(name, range(args.first, args.first + args.count)))
        bad |= any(not outcome.good for _, outcome in found)
        print(f"{name}:", *reported(found), sep="\n", flush=True)
    damaging.worker.close()
    shutil.rmtree(folder)
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
