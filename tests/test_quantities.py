from contextlib import suppress
from typing import Annotated

import pint
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from pydantic_core import PydanticCustomError

from taichi_plume.quantities import USUAL, parse, quantity


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (3, "m", 3.0),
        (0.25, "m", 0.25),
        ("1e-5", "kg/s", 1e-5),  # PyYAML leaves it a text
        ("-.5", "m", -0.5),
        ("20 cm", "m", 0.2),
        ("20cm", "m", 0.2),
        ("10 mg/s", "kg/s", 1e-5),
        ("36 km/h", "m/s", 10.0),
        ("2 min", "s", 120.0),
        ("5 Hz", "1/s", 5.0),
        ("0.119 cm^2/s", "m^2/s", 1.19e-5),
        ("0.119 cm**2/s", "m^2/s", 1.19e-5),
        ("46.069 g/mol", "kg/mol", 0.046069),
        ("3 µm", "m", 3e-6),
        ("  1.5e1 mm ", "m", 0.015),
        ("6 kg m/(s^2 N)", "dimensionless", 6.0),
        ("21 degC", "K", 294.15),
        ("-3.5 °C", "K", 269.65),
        ("2 W/(m^2 K)", "W/m^2/K", 2.0),
        ("10 mg s-1", "kg/s", 1e-5),
        ("10 mg.s-1", "kg/s", 1e-5),
        ("10 mg·s-1", "kg/s", 1e-5),
        ("0.3 m.s-2", "m/s^2", 0.3),
        ("2 W m-2 K-1", "W/m^2/K", 2.0),
        ("420 ppm", "ppm", 420.0),
        ("5 ppb", "ppm", 5e-3),
        ("5 ppt", "ppm", 5e-6),
        ("2 %", "ppm", 2e4),
    ],
)
def test_numbers_and_texts_with_units(value, unit, expected):
    assert parse(value, unit) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("value", "reported"),
    [
        *((value, r"must .*unit .*\bm$") for value in ("", "fast", "cm", "3 m m m/", "1,5 m", "3 m; 4")),
        *((value, r"must .*unit .*\bm$") for value in ("__import__('os')", None, True, [1], {"m": 1})),
        *((f"3 {unit}", "must have a unit that converts to m") for unit in ("kg", "m/s", "m^2", "parrots")),
        # powers that pint would compute for ever
        *((f"1 m{power}", "must") for power in ("**9**9**9", "^(9^(9^9))", "*9**9**9**9", "**999999999")),
        (10**400, "finite"),
    ],
)
def test_what_is_no_quantity_is_refused(value, reported):
    with pytest.raises(PydanticCustomError, match=reported):
        parse(value, "m")


@settings(max_examples=100, deadline=None)
@given(st.text(max_size=30) | st.from_regex(r"[0-9.]{1,4} ?[a-zA-Z*/^() 0-9µ°%]{1,20}", fullmatch=True))
def test_any_text_is_a_number_or_refused(text):
    with suppress(PydanticCustomError):
        assert isinstance(parse(text, "m"), float)


def test_limits_hold_in_si_units():
    tick = TypeAdapter(Annotated[float, *quantity("s", least=1e-4, most=1)])
    assert tick.validate_python("500 ms") == 0.5
    for value in ("0 ms", "2 min", -1, "inf", float("nan")):
        with pytest.raises(ValidationError):
            tick.validate_python(value)


def test_usual_units_are_converted_as_pint_does():
    """To 15 digits, to which both are rounded."""
    registry = pint.UnitRegistry()
    for text, unit in USUAL:
        for value in (0.1, 0.3, 7.0, 12.5, 20.0, 1e-5, 333.3):
            exact = registry.Quantity(value, registry.parse_units(text)).to(unit).magnitude
            assert parse(f"{value} {text}", unit) == float(f"{exact:.15g}")


def test_a_converted_number_is_the_decimal_that_was_written():
    assert parse("20 mg/s", "kg/s") == 2e-5
    assert parse("7 ms", "s") == 0.007
    assert parse("35 ug/s", "kg/s") == 3.5e-8  # by pint
