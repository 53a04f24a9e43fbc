"""Turbulence models of the eddies too small for the grid: Smagorinsky and Vreman (eddy viscosity)."""

from typing import Annotated, Literal

from pydantic import Field

from taichi_plume.scenario import si
from taichi_plume.scenario.vocabulary import Model


class Smagorinsky(Model):
    """Smagorinsky's model, the usual one: an eddy viscosity that grows with the shear.

    (C_s dx)² |S| (Smagorinsky 1963, doi:10.1175/1520-0493(1963)091<0099:GCEWTP>2.3.CO;2). Surfaces slow the air by the
    law of the wall where the cells are thicker than its viscous layer.
    """

    kind: Literal["smagorinsky"]
    constant: si.Intensity = 0.13
    """Strength C_s of the model: size of the small eddies over that of a cell. More damps the flow more: 0.15 keeps a
    channel's middle 9 to 11 % too fast, 0.1 makes a fan's jet spread by 0.106 (measured 0.095)."""
    schmidt: si.Prandtl = 0.7
    """Turbulent Schmidt number: eddy viscosity over eddy diffusivity of gas. A smaller one mixes gas more."""


class Vreman(Model):
    """Vreman's model: an eddy viscosity that vanishes in laminar flow.

    Vreman 2004, doi:10.1063/1.1785131. Surfaces slow the air by the law of the wall where the cells are thicker than
    its viscous layer.
    """

    kind: Literal["vreman"]
    constant: si.Intensity = 0.07
    """Strength of the model, about 2.5 times the square of Smagorinsky's constant. More damps the flow more."""
    schmidt: si.Prandtl = 0.7
    """Turbulent Schmidt number: eddy viscosity over eddy diffusivity of gas. A smaller one mixes gas more."""


class NoModel(Model):
    """Molecular viscosity only, also at surfaces: for flows that the cells resolve."""

    kind: Literal["none"]


Eddies = Annotated[Smagorinsky | Vreman | NoModel, Field(discriminator="kind")]
