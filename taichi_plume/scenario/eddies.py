"""How eddies too small for the grid are modelled, in the air of a scenario."""

from typing import Annotated, Literal

from pydantic import Field

from taichi_plume.scenario.vocabulary import Intensity, Model, Prandtl


class Smagorinsky(Model):
    """Small eddies as a viscosity that grows with the shear: Smagorinsky's model, the usual one.

    (C_s dx)² |S| (Smagorinsky 1963, doi:10.1175/1520-0493(1963)091<0099:GCEWTP>2.3.CO;2). Surfaces slow the air by the
    law of the wall where the cells are thicker than its viscous layer.
    """

    kind: Literal["smagorinsky"]
    constant: Intensity = 0.13
    """Strength C_s of the model: size of the small eddies over that of a cell. More damps the flow more: 0.15 keeps a
    channel's middle 9 to 11 % too fast, 0.1 makes a fan's jet spread by 0.106 (measured 0.095)."""
    schmidt: Prandtl = 0.7
    """Turbulent Schmidt number: eddy viscosity over eddy diffusivity of gas. A smaller one mixes gas more."""


class Vreman(Model):
    """Small eddies as a viscosity that vanishes where the flow is laminar: Vreman's model.

    Vreman 2004, doi:10.1063/1.1785131. Surfaces slow the air by the law of the wall where the cells are thicker than
    its viscous layer.
    """

    kind: Literal["vreman"]
    constant: Intensity = 0.07
    """Strength of the model, about 2.5 times the square of Smagorinsky's constant. More damps the flow more."""
    schmidt: Prandtl = 0.7
    """Turbulent Schmidt number: eddy viscosity over eddy diffusivity of gas. A smaller one mixes gas more."""


class NoModel(Model):
    """Only the molecular viscosity, at surfaces too: for flows that the cells resolve."""

    kind: Literal["none"]


Eddies = Annotated[Smagorinsky | Vreman | NoModel, Field(discriminator="kind")]
