"""What is asked of every opening."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, ClassVar

from taichi_plume.scenario.context import Context
from taichi_plume.scenario.domain import Domain
from taichi_plume.scenario.vocabulary import Color, Model, Temperature, Time, Velocity
from taichi_plume.scenario.windows import Region

if TYPE_CHECKING:
    from taichi_plume.scenario.openings import Opening


class SpeedAt(Model):
    """One step of a schedule: from `at` on, blow with `speed`."""

    at: Time
    """Simulated time [s]; the robots start at 0, the warm-up is before."""
    speed: Velocity


class AnyOpening(Model):
    """What is asked of every opening."""

    color: ClassVar[Color] = (144, 164, 174)
    """In recordings."""

    straight: ClassVar[bool] = False
    """Whether its air comes in parallel, through a honeycomb."""

    @property
    def label(self) -> str:
        """What it is called."""
        return vars(self)["kind"]

    @property
    def blows(self) -> bool:
        """Whether the speed of its air is prescribed, or follows a fan's curve."""
        return False

    @property
    def lets_out(self) -> bool:
        """Whether air may leave through it as the pressure wants."""
        return False

    @property
    def passes(self) -> bool:
        """Whether air goes through it at all."""
        return self.blows or self.lets_out

    @property
    def warms(self) -> bool:
        """Whether the air that comes in has a temperature of its own."""
        return False

    @property
    def region(self) -> Region | None:
        """Where it lies; None where it takes both faces of an axis."""
        return None

    @property
    def wraps(self) -> str | None:
        """The axis along which it makes the domain periodic."""
        return None

    @property
    def changes(self) -> tuple[SpeedAt, ...]:
        """When its speed changes, and to what."""
        return ()

    @property
    def follows_pressure(self) -> bool:
        """Whether its speed follows a fan's curve."""
        return False

    @property
    def knots(self) -> tuple[float, ...]:
        """Times between which its speed changes linearly [s]."""
        return ()

    def top_speed(self, domain: Domain) -> float:
        """Largest speed that is prescribed for it [m/s]."""
        return 0.0

    def inflow(self, t: float, domain: Domain) -> float:
        """Air that is blown in at time t [m³/s]."""
        return 0.0

    def clashes(
        self, where: str, number: int, openings: "Sequence[Opening]", context: Context
    ) -> Iterator[str]:
        """What is wrong with its place, as one of several openings."""
        raise NotImplementedError


class FaceOpening(AnyOpening, Region):
    """An opening on a part of a face."""

    @property
    def region(self) -> Region:
        """Itself."""
        return self

    def clashes(
        self, where: str, number: int, openings: "Sequence[Opening]", context: Context
    ) -> Iterator[str]:
        """It must lie on its face, beside the openings before it."""
        yield from self.on_its_face(where, context)
        for m, other in enumerate(openings[:number]):
            if other.region is not None and self.overlaps(other.region, context.domain):
                yield (
                    f"{where}: overlaps wind.openings[{m}] ({other.kind}) on face {self.face}; "
                    "give both a center and a size that leave them apart"
                )


class Vent(FaceOpening):
    """An opening through which air may come in."""

    temperature: Temperature | None = None
    """Of the air that comes in [K]; unless given, `buoyancy.heat.reference`."""

    @property
    def warms(self) -> bool:
        """Whether the air that comes in has a temperature of its own."""
        return self.temperature is not None

    def problems(self, where: str, context: Context) -> Iterator[str]:
        """A temperature has to have an effect."""
        buoyancy = context.scenario.buoyancy
        if self.warms and (buoyancy is None or buoyancy.heat is None):
            yield (
                f"{where}.temperature: has no effect as the temperature of the air is not computed; "
                "add wind.buoyancy.heat or remove it"
            )
