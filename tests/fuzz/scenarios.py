"""Mutated scenarios: ``python -m tests.fuzz.scenarios --mutants 20000 --seed 1 --run 1200``.

Each has to give a scenario, or faults of a line each, within 10 s and 4 GiB; nothing else. `--run SECONDS` takes as
many of the accepted ones as time allows through their first second, which has to succeed or end with one line. What
does not is written into the folder `--kept`, and `--repro FILE` tries it again.
"""

import argparse
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from math import prod
from pathlib import Path
from tempfile import mkdtemp

from taichi_plume.assembly.preparation import load, load_scenario
from taichi_plume.scenario.loading import ScenarioError, read_scenario
from tests.fuzz import bases
from tests.fuzz.mutate import Mutator
from tests.fuzz.runs import Runner
from tests.fuzz.watched import Outcome, Worker, reported, tried

MEMORY = 4 << 30  # bytes that loading may take
LIMIT = 10.0  # s
MANY_CELLS = 2e6  # of a grid that may take longer
RUN_MEMORY = 16 << 30  # bytes of addresses, of which Taichi takes many
RUN_LIMIT = 40.0  # s, for assembling, compiling and a second
MANY_BUILDS = 25  # simulations after which a process is replaced
SHORT = 0.4  # s, a warm-up that runs hold too


def loader(paths: dict[str, Path]) -> Callable[[tuple[str, str]], Outcome]:
    """Loads mutants (name of the base, text). paths: of the bases."""

    def work(job: tuple[str, str]) -> Outcome:
        path = paths[job[0]].with_name("mutant.yml")
        write(path, job[1])

        def call() -> Outcome:
            load(path)
            return Outcome("accepted")

        begin = time.process_time()
        outcome = tried(call, (ScenarioError,))
        return replace(outcome, large=time.process_time() - begin > LIMIT and _cells(path) > MANY_CELLS)

    return work


def _cells(path: Path) -> float:
    """Of the grid of a mutant, if there is one: to cut millions of them at obstacles takes long."""
    try:
        domain = read_scenario(path).domain
    except ScenarioError:
        return 0.0
    return prod(extent / domain.spacing for extent in domain.extent)


def write(path: Path, text: str) -> None:
    """Write a mutant; what no UTF-8 can hold is written all the same."""
    path.write_bytes(text.encode("utf-8", "surrogatepass"))


class Fuzzing:
    """Mutants of a seed, in a folder; those with faults are kept in another."""

    def __init__(self, folder: Path, seed: int, kept: Path | None = None):
        self.folder, self.kept = folder, kept
        self.paths = bases.make(folder, SHORT)
        whole = {name: load_scenario(path) for name, path in self.paths.items()}
        self.mutator = Mutator(
            {name: path.read_text() for name, path in self.paths.items()},
            {name: one.model_dump(mode="json", exclude_none=True) for name, one in whole.items()},
            seed,
        )
        if kept:
            kept.mkdir(parents=True, exist_ok=True)

    def _noted(self, n: int, name: str, text: str, outcome: Outcome) -> tuple[str, Outcome]:
        if self.kept and not outcome.good:
            write(self.kept / f"{self.mutator.seed}-{n}-{name}.yaml", text)
        return f"{n} of {name}", outcome

    def loaded(self, numbers: range, accepted: list[int] | None = None) -> Iterator[tuple[str, Outcome]]:
        """The names of mutants and what came of loading them; accepted: gets the numbers of those."""
        worker = Worker(partial(loader, self.paths), LIMIT, MEMORY)
        for n in numbers:
            name, text = self.mutator.mutant(n)
            outcome = worker.do((name, text))
            if outcome.kind == "accepted" and accepted is not None:
                accepted.append(n)
            yield self._noted(n, name, text, outcome)
        worker.close()

    def run(self, accepted: list[int], seconds: float) -> Iterator[tuple[str, Outcome]]:
        """What came of the first second of mutants, as many of each base as time allows."""
        os.environ.setdefault("TI_CPU_MAX_NUM_THREADS", "1")
        end = time.monotonic() + seconds
        for k, name in enumerate(self.paths):
            worker = Worker(partial(Runner, self.paths), RUN_LIMIT, RUN_MEMORY)
            stop = time.monotonic() + (end - time.monotonic()) / (len(self.paths) - k)
            builds = 0
            for n in accepted:
                if self.mutator.base(n) != name:
                    continue
                if time.monotonic() > stop:
                    break
                text = self.mutator.mutant(n)[1]
                outcome = worker.do((name, text))
                builds += 1
                if builds % MANY_BUILDS == 0:
                    worker.close()
                yield self._noted(n, name, text, outcome)
            worker.close()


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mutants", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--run", type=float, default=0.0, metavar="SECONDS", help="of wall time, for accepted ones"
    )
    parser.add_argument("--kept", type=Path, help="where mutants with faults are kept")
    parser.add_argument("--repro", type=Path, metavar="FILE", help="load and run this mutant alone")
    args = parser.parse_args()
    folder = Path(mkdtemp())
    fuzzing = Fuzzing(folder, args.seed, args.kept)
    if args.repro:
        text = args.repro.read_bytes().decode("utf-8", "surrogatepass")
        name = args.repro.stem.rpartition("-")[2]
        name = name if name in fuzzing.paths else min(fuzzing.paths)
        outcome = loader(fuzzing.paths)((name, text))
        print(outcome.kind, outcome.text)
        if outcome.kind == "accepted":
            outcome = Runner(fuzzing.paths)((name, text))
            print(outcome.kind, outcome.text)
        return int(not outcome.good)
    accepted: list[int] = []
    numbers = range(args.first, args.first + args.mutants)
    outcomes = list(fuzzing.loaded(numbers, accepted))
    print("loaded:", *reported(outcomes), sep="\n", flush=True)
    if args.run:
        ran = list(fuzzing.run(accepted, args.run))
        print(f"run, of {len(accepted)}:", *reported(ran), sep="\n")
        outcomes += ran
    shutil.rmtree(folder, ignore_errors=True)
    return int(any(not outcome.good for _, outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main())
