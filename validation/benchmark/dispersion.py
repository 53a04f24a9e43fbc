"""Speed of steady dispersion: the response of a sensor to all cells by the adjoint, beside a solution per candidate.

Probabilistic mapping with online dispersion (PMFS, Ojeda et al. 2024) simulates the gas of candidate sources and
compares it with the measurements. Here each candidate is one forward solution of the same equation, for every cell.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

import numpy as np

from taichi_plume.agents.dispersion import Dispersion

ROOMS = {
    "casting_room floor": ((40, 30), 0.1),
    "casting_room floor, fine": ((80, 60), 0.05),
    "room of 6 x 4 x 2.4 m": ((30, 20, 12), 0.2),
}
REPEATS = 7


@dataclass(frozen=True)
class DispersionCost:
    """Medians [ms]: the wind made mass-consistent, factorisation with the first response, each further response, and a
    forward solution for every cell."""

    case: str
    cells: int
    wind_ms: float
    first_ms: float
    response_ms: float
    candidates_ms: float

    def __str__(self) -> str:
        return (
            f"{self.case:28} {self.cells:6} cells  wind {self.wind_ms:6.2f} ms  first response {self.first_ms:6.2f} ms"
            f"  next {self.response_ms:6.3f} ms  all candidates {self.candidates_ms:8.1f} ms"
        )


def _milliseconds(call: Callable[[], object]) -> float:
    began = time.perf_counter()
    call()
    return 1e3 * (time.perf_counter() - began)


def measured(case: str) -> DispersionCost:
    """Return the cost of a room with a disturbed wind and a wall across half of it."""
    shape, cell = ROOMS[case]
    rng = np.random.default_rng(1)
    wind = 0.05 * rng.normal(size=(*shape, len(shape)))
    wind[..., 0] += 0.4
    if len(shape) == 3:
        wind[..., 2] = 0.0
    solid = np.zeros(shape, bool)
    solid[shape[0] // 3, : shape[1] // 2] = True
    sensor = np.zeros(shape)
    sensor[tuple(n * 3 // 4 for n in shape)] = 1.0
    rows = []
    for _ in range(REPEATS):
        model: list[Dispersion] = []
        make = _milliseconds(lambda model=model: model.append(Dispersion(wind, cell, solid)))
        first, following = (_milliseconds(lambda model=model: model[0].adjoint(sensor)) for _ in range(2))
        rows.append((make, first, following))
    rates = np.zeros(shape)

    def every() -> None:
        for at in np.argwhere(~solid):
            rates[:] = 0.0
            rates[tuple(at)] = 1.0
            model[0].concentration(rates)

    make, first, following = (median(column) for column in zip(*rows, strict=True))
    return DispersionCost(case, solid.size, make, first, following, _milliseconds(every))


def rooms(arch: str) -> list[DispersionCost]:
    """Return the costs of all rooms; arch has no effect."""
    return [measured(case) for case in ROOMS]
