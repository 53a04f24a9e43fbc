"""Cache of compiled simulations in a worker process: only the first run of a structure compiles kernels.

Taichi has room for 512 SNode trees and frees them only all at once. Before the trees or the memory run out, Taichi is
restarted and the cache emptied.
"""

import gc
import os
from collections import OrderedDict
from collections.abc import Hashable
from typing import NamedTuple

import psutil
import taichi as ti
from taichi.lang import impl

from taichi_plume.assembly.assemble import build
from taichi_plume.assembly.prepare import Prepared, StructureError
from taichi_plume.grid import kernels
from taichi_plume.scenario.scenario import Scenario
from taichi_plume.simulation import Simulation
from taichi_plume.solvers.filmed import Reel

PLACES = 480  # SNode trees, of 512; beyond them Taichi crashes
USUAL = 40  # trees of a simulation before the first one has been built; usually 16
MOST = 8  # simulations in the cache
SHARE = 0.8  # of the machine's memory per core: Taichi is restarted when this process has grown by more


class CachedSimulation(NamedTuple):
    """A cached simulation, the checked scenario that it was built from, and the film that it plays, if any."""

    prepared: Prepared
    sim: Simulation
    player: Reel | None


class Warm:
    """Simulations of a process, by a key that scenarios share which one simulation can execute.

    The least recently used simulation is dropped first. Taichi runs on one thread, as every core has a process of its
    own. begun: number of starts of Taichi.
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
        """Kernels compiled by this process so far."""
        return self._compiled + (kernels.compiled() if self._alive() else 0)

    def find(self, key: Hashable) -> CachedSimulation | None:
        """Return the cached simulation of a key, which must be reset, or None."""
        if not self._alive():
            self._cached.clear()
        if key in self._cached:
            self._cached.move_to_end(key)
        return self._cached.get(key)

    def reset(self, key: Hashable, scenario: Scenario) -> CachedSimulation | None:
        """Return the cached simulation of a key at the start of a scenario; None if there is none that fits."""
        known = self.find(key)
        try:
            if known is not None:
                known.sim.reset(scenario)
        except StructureError:
            self.drop(key)
            return None
        return known

    def add(self, key: Hashable, prepared: Prepared, player: Reel | None = None) -> CachedSimulation:
        """Assemble a simulation of a checked scenario whose code has been executed. Raises ScenarioError."""
        self._make_room()
        before = _trees()
        try:
            sim = build(prepared, reel=player)
        finally:
            self._largest = max(self._largest, _trees() - before)
        self._cached[key] = CachedSimulation(prepared, sim, player)
        return self._cached[key]

    def drop(self, key: Hashable) -> None:
        """Remove a simulation in which an error occurred."""
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
            self._compiled += kernels.compiled()
        self._cached.clear()
        gc.collect()
        ti.reset()
        self.backend = kernels.start("cpu", threads=1)
        self._program = impl.get_runtime().prog
        self.begun += 1
        self._memory = psutil.Process().memory_info().rss


WARM = Warm()
"""Simulations of this process."""


def _trees() -> int:
    """Number of SNode trees that Taichi holds."""
    program = impl.get_runtime().prog
    return program.get_snode_tree_size() if program else 0
