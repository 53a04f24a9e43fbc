"""Engine: Taichi or Quadrants, which only this package names; fields in NumPy's memory, kernels that know no room."""

MAY_IMPORT: tuple[str, ...] = ("guard",)
