"""Cache of compiled simulations in a worker process: only the first run of a structure compiles kernels.

Taichi holds at most 512 SNode trees and can free them only all together. Before trees or memory run out, Taichi is
restarted and the cache emptied.
"""

import gc
import os
from collections import OrderedDict
from collections.abc import Hashable
from typing import NamedTuple

import psutil
from taichi.lang import impl

from taichi_plume.assembly.assemble import build
from taichi_plume.assembly.preparation import Prepared, StructureError
from taichi_plume.engine import program, ti
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.solvers.playback import TickFilm
from taichi_plume.time_loop import TimeLoop

PLACES = 480  # SNode trees in use, of 512; Taichi crashes beyond 512
USUAL = 40  # assumed number of trees of the first simulation; usually 16
MOST = 8  # most simulations in the cache
SHARE = 0.8  # growth of this process after which Taichi is restarted, as a fraction of the memory per core


class CachedSimulation(NamedTuple):
    """A cached simulation with the checked scenario that it was built from, and the player of a film, if any."""

    prepared: Prepared
    sim: TimeLoop
    player: TickFilm | None


class Warm:
    """LRU cache of the simulations of a process. Scenarios that one simulation can execute have the same key.

    Taichi runs on one thread, as every core has a worker process of its own. begun: number of starts of Taichi.
    """

    def __init__(self, most: int = MOST):
        self.most = most
        self.begun = 0
        self.backend = ""
        self._cached: OrderedDict[Hashable, CachedSimulation] = OrderedDict()
        self._program: object = None
        self._largest = USUAL
        self._memory = 0
        self._compiled = 0

    @property
    def compiled(self) -> int:
        """Number of Taichi kernels that this process has compiled so far."""
        return self._compiled + (program.compiled() if self._alive() else 0)

    def find(self, key: Hashable) -> CachedSimulation | None:
        """Return the cached simulation of a key, to be reset by the caller; None if there is none."""
        if not self._alive():
            self._cached.clear()
        if key in self._cached:
            self._cached.move_to_end(key)
        return self._cached.get(key)

    def reset(self, key: Hashable, scenario: Scenario) -> CachedSimulation | None:
        """Return the cached simulation of a key, reset to the start of a scenario; None without a suitable one."""
        known = self.find(key)
        try:
            if known is not None:
                known.sim.reset(scenario)
        except StructureError:
            self.drop(key)
            return None
        return known

    def add(self, key: Hashable, prepared: Prepared, player: TickFilm | None = None) -> CachedSimulation:
        """Build and cache a simulation of a checked scenario after its Python files were run. Raises ScenarioError."""
        self._make_room()
        before = _trees()
        try:
            sim = build(prepared, film=player)
        finally:
            self._largest = max(self._largest, _trees() - before)
        self._cached[key] = CachedSimulation(prepared, sim, player)
        return self._cached[key]

    def drop(self, key: Hashable) -> None:
        """Remove a simulation from the cache, after an error."""
        self._cached.pop(key, None)

    def _alive(self) -> bool:
        return self._program is not None and impl.get_runtime().prog is self._program

    def _make_room(self) -> None:
        """Start Taichi, or restart it when its SNode trees or memory are nearly used up."""
        while len(self._cached) >= self.most:
            self._cached.popitem(last=False)
        if self._alive():
            grown = psutil.Process().memory_info().rss - self._memory
            allowed = SHARE * psutil.virtual_memory().total / (os.cpu_count() or 1)
            if _trees() + 1.5 * self._largest < PLACES and grown < allowed:
                return
            self._compiled += program.compiled()
        self._cached.clear()
        gc.collect()
        ti.reset()
        self.backend = program.start("cpu", threads=1)
        self._program = impl.get_runtime().prog
        self.begun += 1
        self._memory = psutil.Process().memory_info().rss


WARM = Warm()
"""Cached simulations of this process."""


def _trees() -> int:
    """Number of SNode trees that Taichi holds."""
    program = impl.get_runtime().prog
    return program.get_snode_tree_size() if program else 0
