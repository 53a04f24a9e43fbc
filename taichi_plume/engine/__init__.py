"""Engine: Taichi, with fields in NumPy's memory and kernels that know no room. Only this package names Taichi."""

MAY_IMPORT: tuple[str, ...] = ("guard",)
