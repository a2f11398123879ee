"""Units as data sheets and benches write them, with their SI factors."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

_RPM = 2.0 * math.pi / 60.0
_OUNCE_INCH = 7.0615518e-3  # [N m]
AMPERE = {"A": 1.0, "mA": 1e-3}
VOLT = {"V": 1.0, "mV": 1e-3}
OHM = {"ohm": 1.0, "mohm": 1e-3}
HENRY = {"H": 1.0, "mH": 1e-3, "uH": 1e-6}
WEBER = {"Wb": 1.0, "mWb": 1e-3, "V s": 1.0}
SPEED = {"rad/s": 1.0, "rpm": _RPM}
SECOND = {"s": 1.0, "ms": 1e-3, "min": 60.0}
TORQUE = {"N m": 1.0, "mN m": 1e-3, "N cm": 1e-2, "oz in": _OUNCE_INCH, "lb ft": 192.0 * _OUNCE_INCH}
INERTIA = {
    "kg m^2": 1.0, "kg cm^2": 1e-4, "g cm^2": 1e-7, "g m^2": 1e-3, "kg mm^2": 1e-6, "g mm^2": 1e-9,
    "oz in s^2": _OUNCE_INCH,
}  # fmt: skip
KELVIN_PER_WATT = {"K/W": 1.0, "degC/W": 1.0, "C/W": 1.0}
BACK_EMF = {
    "V s/rad": 1.0, "V/(rad/s)": 1.0, "V/krpm": 1e-3 / _RPM, "V/rpm": 1.0 / _RPM, "mV/rpm": 1e-3 / _RPM,
}  # fmt: skip
KV = {"rpm/V": _RPM, "rad/s/V": 1.0, "rad/(s V)": 1.0}
PER_AMPERE = {"N m/A": 1.0, "mN m/A": 1e-3, "oz in/A": _OUNCE_INCH}

_ALIASES = {"1/min": "rpm", "u/min": "rpm", "r/min": "rpm", "c": "degc"}


def unit_factor(units: Mapping[str, float], written: str) -> float:
    """SI factor of a unit, whatever its blanks, dots, capitals, Ω, µ and ²; NaN for one of something else."""
    plain = _plain(written)
    return {_plain(unit): factor for unit, factor in units.items()}.get(_ALIASES.get(plain, plain), math.nan)


def _plain(unit: str) -> str:
    """One spelling for the many of a unit: small letters, no blanks, dots and dashes, ``u`` for micro."""
    unit = unit.replace("²", "^2").replace("Ω", "ohm").replace("Ω", "ohm").replace("°", "deg")
    unit = re.sub("[µμ]", "u", unit)
    return re.sub(r"[\s·*⋅.-]", "", unit).casefold().replace("ω", "ohm").replace("m2", "m^2")
