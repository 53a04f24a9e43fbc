"""What has a place in the air."""

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from taichi_plume.scenario.context import Context, span
from taichi_plume.scenario.vocabulary import Model, Point


class Located(Model):
    """A section with a position, which must be one of air."""

    what: ClassVar[str] = "source"
    """It is called so."""
    position: Point
    """Where its middle is, per axis. It has to be in the air: in the room and outside of all obstacles."""

    def problems(self, where: str, context: Context) -> Iterator[str]:
        position = self.position
        extent = context.domain.extent
        outside = [a for a, x in enumerate(position) if not 0 <= x <= extent[a]]
        if outside:
            axis = "xyz"[outside[0]]
            yield (
                f"{where}.position: {axis} = {position[outside[0]]:g} m is outside the domain, "
                f"{span(axis, 0, extent[outside[0]])}; move the {self.what} in"
            )
            return
        radius = vars(self).get("radius", 0.0)
        if radius > max(extent):
            yield f"{where}.radius: {radius:g} m is larger than the domain, {max(extent):g} m; make it smaller"
            return
        for obstacle, one in context.resources.shapes.items():
            if one.inside(np.array([position]))[0]:
                place = ", ".join(f"{x:g}" for x in position)
                deep = -float(one.signed_distance(np.array([position]))[0])
                yield (
                    f"{where}.position: ({place}) m is inside {obstacle} ({one.model.kind}), "
                    f"{deep:.3g} m below its surface; move the {self.what} or the obstacle"
                )
                return
