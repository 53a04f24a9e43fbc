"""Staggered grid: fields, kernels, obstacles as shapes, cut cells, state of a run, random numbers."""

MAY_IMPORT: tuple[str, ...] = (
    "engine",
    "guard",
)
