"""Types of numbers in a scenario: quantities in SI units with their limits, plain numbers, points and vectors."""

from typing import Annotated

from pydantic import Field

from taichi_plume.quantities import number, quantity
from taichi_plume.scenario.gas_amounts import mass
from taichi_plume.scenario.vocabulary import PER_AXIS, one_or_several

# Each kind of quantity with its limits: wide (micrometres to 100 km, seconds to decades) but finite, as a value beyond
# them is a slip of the unit or the keyboard. Coordinates may be those of a map.
Coordinate = Annotated[float, *quantity("m", least=-1e7, most=1e7)]
Length = Annotated[float, *quantity("m", least=1e-6, most=1e5, likely="mm")]
Distance = Annotated[float, *quantity("m", least=0, most=1e5, likely="mm")]
# of robots: contact is 0.1 mm:
BodyLength = Annotated[float, *quantity("m", least=1e-3, most=100, likely="mm")]
Duration = Annotated[float, *quantity("s", least=1e-6, most=1e9)]
Time = Annotated[float, *quantity("s", least=-1e9, most=1e9)]
Delay = Annotated[float, *quantity("s", least=1e-6, most=1e9, or_zero=True)]
Wait = Annotated[float, *quantity("s", least=1e-6, most=1e5)]  # robots count it in ticks, in 32 bits
Pause = Annotated[float, *quantity("s", least=0, most=1e5)]  # likewise
# air is incompressible up to about there:
Speed = Annotated[float, *quantity("m/s", least=0, most=100, likely="mm/s")]
Velocity = Annotated[float, *quantity("m/s", least=-100, most=100, likely="mm/s")]
Acceleration = Annotated[float, *quantity("m/s^2", least=-1000, most=1000)]
Thrust = Annotated[float, *quantity("m/s^2", least=1e-6, most=1e4)]
Rate = Annotated[float, *quantity("kg/s", least=0, most=1, likely="mg/s", reader=mass)]  # of gases
Mass = Annotated[float, *quantity("kg", least=0, most=1, likely="mg", reader=mass)]  # likewise
BodyMass = Annotated[float, *quantity("kg", least=1e-4, most=1000, likely="g")]
Frequency = Annotated[float, *quantity("1/s", least=1e-9, most=1e6)]
FrameRate = Annotated[float, *quantity("1/s", least=1e-3, most=1000)]  # of cameras
Latency = Annotated[float, *quantity("s", least=0, most=10)]
MolarMass = Annotated[float, *quantity("kg/mol", least=1e-3, most=1, likely="g/mol")]
Pressure = Annotated[float, *quantity("Pa", least=1e-9, most=1e6)]
FlowRate = Annotated[float, *quantity("m^3/s", least=1e-9, most=1000, likely="m^3/h")]
TopSpeed = Annotated[float, *quantity("m/s", least=1e-6, most=100, likely="mm/s")]
Tick = Annotated[float, *quantity("s", least=1e-4, most=1)]
Viscosity = Annotated[float, *quantity("m^2/s", least=0, most=1, likely="mm^2/s")]  # as in exact solutions
Diffusivity = Annotated[float, *quantity("m^2/s", least=0, most=1, likely="mm^2/s")]  # of molecules
EddyDiffusivity = Annotated[float, *quantity("m^2/s", least=0, most=1e4)]
Dissipation = Annotated[float, *quantity("m^2/s^3", least=1e-12, most=1e3)]
Temperature = Annotated[float, *quantity("K", least=200, most=500, likely="degC")]
Power = Annotated[float, *quantity("W", least=-1e7, most=1e7)]
# of gas that reaches a surface:
SurfaceVelocity = Annotated[float, *quantity("m/s", least=1e-9, most=1, likely="mm/s")]
Concentration = Annotated[float, *quantity("ppm", least=0, most=1e6)]
HeatTransfer = Annotated[float, *quantity("W/m^2/K", least=1e-6, most=1e6)]
HeatCapacity = Annotated[float, *quantity("J/m^3/K", least=1, most=1e8)]
Resistance = Annotated[float, *quantity("ohm", least=1, most=1e9)]
LatentHeat = Annotated[float, *quantity("J/kg", least=1e4, most=1e8, likely="MJ/kg")]
Expansion = Annotated[float, *quantity("1/K", least=0, most=1)]
Fraction = Annotated[float, *number(0, 1)]
SomeFraction = Annotated[float, *number(1e-6, 1)]
Angle = Annotated[float, *number(-1e4, 1e4, "deg")]
AngleNoise = Annotated[float, *number(0, 1e4, "deg")]
TurnRate = Annotated[float, *number(1e-3, 1e6, "deg/s")]
Ppm = Concentration
SomePpm = Annotated[float, *quantity("ppm", least=1e-9, most=1e6)]
FullScale = Annotated[float, *quantity("ppm", least=1e-6, most=1e6)]
Intensity = Annotated[float, *number(0, 10)]
Coefficient = Annotated[float, *number(0, 1e6)]
SomeCoefficient = Annotated[float, *number(1e-6, 1e6)]
Prandtl = Annotated[float, *number(0.01, 100)]
Exponent = Annotated[float, *number(0.01, 10)]
Swirl = Annotated[float, *number(-100, 100)]
Magnitude = Annotated[float, *number(1e-12, 1e12)]  # in a unit of someone else's
Missing = Annotated[float, *number(-1e12, 1e12)]  # a number that means none
Count = Annotated[int, Field(ge=1, le=1_000_000)]
Point = Annotated[tuple[Coordinate, ...], Field(min_length=2, max_length=3), PER_AXIS]
Edges = Annotated[tuple[Length, ...], Field(min_length=2, max_length=3), PER_AXIS]
Velocities = Annotated[tuple[Velocity, ...], Field(min_length=2, max_length=3), PER_AXIS]
Accelerations = Annotated[tuple[Acceleration, ...], Field(min_length=2, max_length=3), PER_AXIS]
Point2 = tuple[Coordinate, Coordinate]
Diffusivities = one_or_several(EddyDiffusivity, 3)
Intensities = one_or_several(Intensity, 3)
