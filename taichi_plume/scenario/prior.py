"""Prior of the source's position, the belief before the first reading: a picture, an array or areas with weights."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from taichi_plume.scenario import si
from taichi_plume.scenario.vocabulary import AT_START, INPUT_FILE, Model, consistency_check, exactly_one

MOST_ROWS = 1000  # of weights in the YAML file


class PriorArea(Model):
    """A polygon on the floor with a weight."""

    vertices: Annotated[tuple[si.Point2, ...], Field(min_length=3, max_length=1000)]
    """Corners of the polygon, each [x, y], in order along its outline."""
    weight: si.Coefficient
    """Weight per area of floor, beside `rest` and other polygons. With 9 and a rest of 1 a source is 9 times as likely
    there per square metre."""


Weights = Annotated[tuple[si.Coefficient, ...], Field(min_length=1, max_length=MOST_ROWS)]


class Prior(Model):
    """Prior of the source's position over the floor, such as a camera's or a planner's guess. See files/prior_map.py.

    Weights count per area. Only their ratios matter: the cells of the belief take their means and are scaled to sum 1.
    """

    file: Annotated[str, Field(min_length=1), INPUT_FILE] | None = None
    """File of weights: a picture, whose grey is the weight, or an array. A picture (PNG, PGM, PPM or BMP) weighs 0
    where it is black or transparent, 1 where it is white. An array (.npy, or `prior` or the only one in .npz) has axes
    (y, x), its first row at the lowest y as in maps.zarr."""
    values: Annotated[tuple[Weights, ...], Field(min_length=1, max_length=MOST_ROWS), AT_START] | None = None
    """Weights in rows along x, the first row at the lowest y."""
    areas: Annotated[tuple[PriorArea, ...], Field(min_length=1, max_length=1000), AT_START] | None = None
    """Polygons on the floor, each with a weight; the last one counts where they overlap."""
    rest: Annotated[si.Coefficient, AT_START] = 1.0
    """Weight per area outside of all areas."""
    resolution: Annotated[si.Length, AT_START] | None = None
    """Edge of the pixels of a file, or of the values. Unless given, they span the floor of the robots."""
    origin: Annotated[si.Point2, AT_START] | None = None
    """Position of their lower left corner, x and y. Unless given, it is that of the floor."""

    _single_form = exactly_one("file", "values", "areas")

    @consistency_check
    def _keys_fit(self) -> Iterator[str]:
        for key in ("resolution", "origin") if self.areas else ("rest",):
            if key in self.model_fields_set:
                yield f"{key}: is for {'a file or values' if self.areas else 'areas'}; remove it"
        if self.values and len({len(row) for row in self.values}) > 1:
            lengths = sorted({len(row) for row in self.values})
            yield f"values: its rows have {lengths[0]} to {lengths[-1]} numbers; all rows need the same count"
