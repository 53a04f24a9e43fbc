"""Observer: samples a simulation once per instant on all views, for the store, the viewer and live pictures."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.observed import planes
from taichi_plume.observed.planes import Lattice, Raster
from taichi_plume.observed.quantities import Quantity
from taichi_plume.observed.views import View, layout, samples_of
from taichi_plume.time_loop import Every, TimeLoop

if TYPE_CHECKING:
    import xarray

Pictures = Mapping[str, np.ndarray]
"""Values of views at one instant, by the names of the views: float32, (first axis, second axis[, third axis])."""


class Observer:
    """Sampler of a simulation on views. Whoever shows or stores views is added to `shown_by`.

    Pixels without air are NaN. A pixel is the largest value that it covers.
    """

    def __init__(self, sim: TimeLoop, views: Sequence[View]):
        self.views = list(views)
        self.samples: dict[str, Raster | Lattice] = {view.name: samples_of(view, sim) for view in self.views}
        self.shown_by: list[Callable[[TimeLoop, Pictures], object]] = []
        self._points: dict[str, np.ndarray] = {}
        self._centers: np.ndarray | None = None

    def observers(self) -> list[Every]:
        """Return an observer of the time loop for each rate of the views."""
        rates = dict.fromkeys(view.rate for view in self.views)
        groups = [(rate, [view for view in self.views if view.rate == rate]) for rate in rates]
        return [Every(1 / rate, self._taking(group), warm_up=True) for rate, group in groups]

    def _taking(self, group: list[View]) -> Callable[[TimeLoop], None]:
        def take(sim: TimeLoop) -> None:
            pictures = self.observe(sim, group)
            for show in self.shown_by:
                show(sim, pictures)

        return take

    def observe(self, sim: TimeLoop, views: Sequence[View] | None = None) -> dict[str, np.ndarray]:
        """Return the present values of views, by default all, by their names."""
        cells: dict[str, np.ndarray] = {}
        pictures: dict[str, np.ndarray] = {}
        for view in self.views if views is None else views:
            quantity, sample = view.quantity, self.samples[view.name]
            if sample.finer:
                assert quantity.points is not None
                values = quantity.points(sim, self._places(view.name, sample))
                pictures[view.name] = sample.of_samples(values) if isinstance(sample, Raster) else values
                continue
            if quantity.key not in cells:
                cells[quantity.key] = quantity.everywhere(sim, lambda: self._cell_centers(sim))
            if quantity.components:
                of = [sample.of_cells(component) for component in cells[quantity.key]]
                pictures[view.name] = np.stack(of)
            else:
                pictures[view.name] = sample.of_cells(cells[quantity.key])
            if view.plane.over_height:  # slices that are finer than cells may show more
                for other in self._finer_slices(view.quantity):
                    if other in pictures:
                        peaks = planes.largest(pictures[other], pictures[view.name].shape)
                        pictures[view.name] = np.fmax(pictures[view.name], peaks)
        return pictures

    def _finer_slices(self, quantity: Quantity) -> list[str]:
        return [
            view.name
            for view in self.views
            if view.quantity is quantity and view.plane.letters == "xy" and self.samples[view.name].finer
        ]

    def _places(self, name: str, sample: Raster | Lattice) -> np.ndarray:
        if name not in self._points:
            self._points[name] = sample.points.astype(np.float32)
        return self._points[name]

    def _cell_centers(self, sim: TimeLoop) -> np.ndarray:
        if self._centers is None:
            self._centers = sim.grid.centers().astype(np.float32)
        return self._centers

    def dataset(self, sim: TimeLoop, views: Sequence[View] | None = None) -> "xarray.Dataset":
        """Return the present values of views, by default all, as a dataset without a time axis."""
        seen = self.views if views is None else list(views)
        pictures, shape = self.observe(sim, seen), layout(seen, self.samples)
        return shape.dataset([each.values(pictures) for each in shape.variables], round(sim.t, 9))
