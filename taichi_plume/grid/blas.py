"""BLAS threads: one while a simulation is made or advances, however many threads the caller's NumPy uses.

With more threads BLAS sums in another order. The results of a run would then depend on the number of cores, and after a
product the second thread spins for 20 ms on the core that kernels need.
"""

from typing import TypedDict

import scipy.linalg  # noqa: F401  it loads SciPy's BLAS, which the controller then finds beside NumPy's
from threadpoolctl import ThreadpoolController

_BLAS = ThreadpoolController().select(user_api="blas")

one_blas_thread = _BLAS.wrap(limits=1)
"""Decorator of functions in which BLAS uses one thread; outside of them the caller's number of threads stays."""


class BlasLibrary(TypedDict):
    """Name, version and kernels (such as "SkylakeX") of a BLAS library that NumPy or SciPy has loaded."""

    name: str
    version: str | None
    kernels: str | None


def blas_libraries() -> list[BlasLibrary]:
    """Return the loaded BLAS libraries. Their kernels, chosen for the processor, decide the last bits of products."""
    return [
        {
            "name": library["internal_api"],
            "version": library["version"],
            "kernels": library.get("architecture"),
        }
        for library in sorted(_BLAS.info(), key=lambda library: str(library["version"]))  # else by chance
    ]
