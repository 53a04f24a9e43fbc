"""First second of accepted mutants, in a simulation of their base that is reset."""

import time
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.watched import Outcome, tried

SECOND = 1.0  # s, simulated
LONGEST = 8.0  # s of wall time, after which a run that goes on is left alone
MOST_CELLS = 60_000
MOST_ROBOTS = 2_000
FINITE = ("flow", "gas")  # parts of a result that are known from the beginning


class Runner:
    """Runs mutants (name of the base, text) for a second. paths: of the bases, beside their files."""

    def __init__(self, paths: dict[str, Path]):
        self.paths, self.file = paths, next(iter(paths.values())).with_name("running.yml")
        self.name, self.sim = "", None

    def __call__(self, job: tuple[str, str]) -> Outcome:
        """The outcome."""
        from taichi_plume.assembly.preparation import load
        from taichi_plume.files.own_class import OwnAlgorithmError
        from taichi_plume.scenario.loading import ScenarioError
        from taichi_plume.time_loop import UnstableError

        name, text = job
        self.file.write_bytes(text.encode("utf-8", "surrogatepass"))
        try:
            prepared = load(self.file)
        except ScenarioError as error:  # another one than the loading worker's, such as for want of memory
            return Outcome("refused", str(error))
        outcome = tried(lambda: self._run(name, prepared), (ScenarioError, UnstableError, OwnAlgorithmError))
        if outcome.kind not in ("accepted", "refused"):
            self.name = ""  # what a fault leaves behind is not used again
        return outcome

    def _run(self, name: str, prepared: Any) -> Outcome:
        from taichi_plume.assembly.preparation import load

        scenario = prepared.scenario
        robots = sum(group.count * group.trials for group in scenario.robots)
        if np.prod([float(n) for n in scenario.domain.shape]) > MOST_CELLS or robots > MOST_ROBOTS:
            return Outcome("accepted", place="too large to run")
        if self.name != name:
            self.sim = self._built(load(self.paths[name]))
            self.name = name
        self.sim.reset(scenario)
        return self._second(self.sim)

    @staticmethod
    def _built(prepared: Any) -> Any:
        from taichi_plume.assembly.assemble import build
        from taichi_plume.assembly.own_code import execute
        from taichi_plume.engine import program

        execute(prepared, allow=True)
        program.start("cpu")
        return build(prepared)

    @staticmethod
    def _second(sim: Any) -> Outcome:
        """Go on for a second, and for one of the robots where the warm-up is as short; then look at the result."""
        from taichi_plume.execution.result import result
        from taichi_plume.scoring.maps import MapScores

        scores = MapScores(sim)
        sim.observers.append(scores.observer())
        end = sim.t + SECOND if sim.t < -SECOND else SECOND
        begin = time.perf_counter()
        sim.observe()
        while not sim.finished and sim.t < end and time.perf_counter() - begin < LONGEST:
            sim.advance()
            sim.observe()
        sim.observe(force=True)
        content = result(sim, "completed", "", "cpu", scores)
        odd = [path for part in FINITE for path in _odd(content[part], part)]
        now = sim.swarm.snapshot() if sim.swarm.count else {}
        odd += [
            key
            for key in ("position", "heading", "true_ppm")
            if key in now and not np.isfinite(now[key]).all()
        ]
        if odd:
            return Outcome("nan", f"t = {sim.t}: {', '.join(odd)}", odd[0])
        return Outcome("accepted")


def _odd(value: Any, path: str) -> list[str]:
    """Paths of numbers in a result that are not finite."""
    if isinstance(value, dict):
        return [odd for key, part in value.items() for odd in _odd(part, f"{path}.{key}")]
    if isinstance(value, (list, tuple)):
        return [odd for n, part in enumerate(value) for odd in _odd(part, f"{path}[{n}]")]
    return [path] if isinstance(value, float) and not isfinite(value) else []
