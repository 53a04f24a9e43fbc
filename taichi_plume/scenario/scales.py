"""Units in which quantities are printed, and which messages name: a number with a unit of a sensible scale."""

# Units by the SI unit of a key, each with its size in that unit; ascending.
SCALES: dict[str, dict[str, float]] = {
    "m": {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "km": 1e3},
    "s": {"us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0},
    "m/s": {"um/s": 1e-6, "mm/s": 1e-3, "cm/s": 1e-2, "m/s": 1.0, "km/h": 1 / 3.6},
    "m/s^2": {"mm/s^2": 1e-3, "m/s^2": 1.0},
    "m^2/s": {"mm^2/s": 1e-6, "cm^2/s": 1e-4, "m^2/s": 1.0},
    "m^3/s": {"mL/s": 1e-6, "L/s": 1e-3, "m^3/h": 1 / 3600.0, "m^3/s": 1.0},
    "kg/s": {"ug/s": 1e-9, "mg/s": 1e-6, "g/s": 1e-3, "kg/s": 1.0, "g/h": 1e-3 / 3600.0},
    "kg": {"ug": 1e-9, "mg": 1e-6, "g": 1e-3, "kg": 1.0},
    "kg/mol": {"g/mol": 1e-3, "kg/mol": 1.0},
    "kg/m^3": {"mg/m^3": 1e-6, "g/m^3": 1e-3, "kg/m^3": 1.0},
    "Pa": {"mPa": 1e-3, "Pa": 1.0, "hPa": 1e2, "kPa": 1e3},
    "K": {"K": 1.0, "degC": 1.0},
    "W": {"mW": 1e-3, "W": 1.0, "kW": 1e3},
    "J/kg": {"J/kg": 1.0, "kJ/kg": 1e3, "MJ/kg": 1e6},
    "1/s": {"mHz": 1e-3, "Hz": 1.0, "kHz": 1e3},
    "ohm": {"ohm": 1.0, "kohm": 1e3, "Mohm": 1e6},
    "ppm": {"ppb": 1e-3, "ppm": 1.0, "%": 1e4},
}
_READ_ONLY = {
    "km/h",
    "m^3/h",
    "g/h",
    "degC",
    "km",
    "hPa",
    "cm^2/s",
    "%",
}  # named in messages, but never printed


def short(value: float) -> str:
    """The shortest text of a number to 15 digits, such as 2e-05 for 1.9999999999999998e-05."""
    text = f"{value:.15g}"
    return (
        repr(float(text)).removesuffix(".0")
        if "e" not in text
        else text.replace("e-0", "e-").replace("e+", "e")
    )


def with_unit(value: float, unit: str) -> str:
    """A number with its unit in a sensible scale, such as "20 mg/s" for 2e-5 kg/s; without a unit the number alone.

    The text reads back as the same value to 15 digits.
    """
    name = {"1/s": "Hz"}.get(unit, unit)
    if not name[:1].isalpha():  # such as 1/K, which no text can name
        return short(value)
    found = f"{short(value)} {name}"
    if value == 0 or 0.1 <= abs(value) < 1e4:
        return found
    scales = [(name, size) for name, size in SCALES.get(unit, {}).items() if name not in _READ_ONLY]
    texts = [
        f"{short(value / size)} {name}" for name, size in scales if abs(value) >= 0.1 * size * (1 - 1e-9)
    ]
    return min([*texts[-1:], found], key=len)


def units_like(unit: str) -> str:
    """Units that a key in `unit` takes, for messages."""
    return ", ".join(SCALES.get(unit, [unit]))
