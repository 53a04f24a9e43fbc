"""The staggered grid and what lives on it: fields, kernels, shapes, cut cells, random numbers."""

MAY_IMPORT: tuple[str, ...] = ("guard",)
