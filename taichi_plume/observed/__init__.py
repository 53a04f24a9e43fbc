"""Observation of a run: declared views, their values sampled once per instant, and the store `pictures.zarr`."""

MAY_IMPORT: tuple[str, ...] = ("files", "grid", "scenario", "time_loop")
