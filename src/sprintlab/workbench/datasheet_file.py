"""Reading a data sheet: entries with their units and conventions, as the maker prints them.

A sheet is a TOML file with one ``[datasheet]`` table. A physical entry is a text with its unit, and where
makers differ also the convention: ``kv = { value = "100 rpm/V", voltage = "dc" }``. Nothing is assumed: a
missing unit or convention is an error that lists what may be written.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

from sprintlab.core.errors import InvalidValueError, MissingValueError
from sprintlab.core.reading import read_toml
from sprintlab.workbench import units
from sprintlab.workbench.units import unit_factor

BETWEEN = ("lines", "phase")
VOLTAGES = ("line-to-line amplitude", "line-to-line rms", "phase amplitude", "phase rms")
CURRENTS = ("line amplitude", "line rms", "phase amplitude", "phase rms", "dc")
SIDES = ("motor", "output")
CONNECTIONS = ("star", "delta")


class EntryKind(NamedTuple):
    """What one entry of a sheet may say."""

    units: Mapping[str, float]  # SI factor by unit; ``parse_quantity`` understands other spellings
    key: str = ""  # that says what was measured; it must be given
    words: tuple[str, ...] = ()  # which it may hold
    sided: bool = False  # may be measured at the gear's output (``at``)


ENTRIES: dict[str, EntryKind] = {
    "resistance": EntryKind(units.OHM, "between", BETWEEN),
    "inductance": EntryKind(units.HENRY, "between", BETWEEN),
    "q_axis_inductance": EntryKind(units.HENRY),
    "flux_linkage": EntryKind(units.WEBER),
    "back_emf_constant": EntryKind(units.BACK_EMF, "voltage", VOLTAGES, sided=True),
    "kv": EntryKind(units.KV, "voltage", (*VOLTAGES, "dc"), sided=True),
    "torque_constant": EntryKind(units.PER_AMPERE, "current", CURRENTS, sided=True),
    "rated_current": EntryKind(units.AMPERE, "current", CURRENTS),
    "peak_current": EntryKind(units.AMPERE, "current", CURRENTS),
    "rated_torque": EntryKind(units.TORQUE, sided=True),
    "peak_torque": EntryKind(units.TORQUE, sided=True),
    "peak_duration": EntryKind(units.SECOND),
    "winding_time_constant": EntryKind(units.SECOND),
    "housing_time_constant": EntryKind(units.SECOND),
    "winding_thermal_resistance": EntryKind(units.KELVIN_PER_WATT),
    "housing_thermal_resistance": EntryKind(units.KELVIN_PER_WATT),
    "no_load_speed": EntryKind(units.SPEED, sided=True),
    "no_load_voltage": EntryKind(units.VOLT),
    "rotor_inertia": EntryKind(units.INERTIA),
}
"""Entries with a unit, by name."""

_PLAIN = ("name", "source", "connection", "poles", "pole_pairs", "saturation", "gear_ratio", "flux_from")
_LONGEST_TEXT = 100  # characters of an entry
_NUMBER = re.compile(r"\s*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*(.*)")


class Entry(NamedTuple):
    """One entry, unit taken off."""

    name: str  # a key of ``ENTRIES``
    text: str  # as written
    value: float  # in SI
    convention: str  # the word that says what was measured; empty where none is needed
    ambiguous: tuple[str, ...]  # the words to choose from where the sheet gives none
    at_output: bool  # measured behind the gear


@dataclass(frozen=True, kw_only=True)
class Datasheet:
    """A data sheet as read."""

    name: str  # Name of the motor
    source: str  # Where its numbers come from
    connection: str  # ``"star"``, ``"delta"`` or empty
    pole_pairs: int  # N [-]
    saturation: float | None  # Alpha if the sheet gives it [-]
    gear_ratio: float | None  # If the sheet gives numbers at a gear's output [-]
    flux_from: str  # The entry that decides the flux where entries contradict each other; empty for none
    entries: Mapping[str, Entry]  # By name


def load_datasheet(path: str | os.PathLike[str]) -> Datasheet:
    """Read a data sheet."""
    document = read_toml(path, what="data sheet")
    if set(document) != {"datasheet"} or not isinstance(document["datasheet"], dict):
        raise InvalidValueError(f"{path}", sorted(document), "must hold exactly one table, [datasheet]")
    try:
        return read_datasheet(cast("Mapping[str, Any]", document["datasheet"]))
    except InvalidValueError as error:
        raise InvalidValueError(f"{path}: {error.field}", error.value, error.allowed) from error


def read_datasheet(table: Mapping[str, Any]) -> Datasheet:
    """A sheet from its table."""
    known = (*_PLAIN, *ENTRIES)
    for key, value in table.items():
        if key not in known:
            raise InvalidValueError(key, value, "unknown entry; choose among " + ", ".join(known))
    connection, flux_from = str(table.get("connection", "")), str(table.get("flux_from", ""))
    if connection not in ("", *CONNECTIONS):
        raise InvalidValueError("connection", connection, "choose star or delta")
    entries = {key: _entry(key, value) for key, value in table.items() if key in ENTRIES}
    if flux_from not in ("", *entries):
        raise InvalidValueError("flux_from", flux_from, "must name an entry of the sheet")
    return Datasheet(
        name=str(table.get("name", "")),
        source=str(table.get("source", "")),
        connection=connection,
        pole_pairs=_pole_pairs(table),
        saturation=_plain_number(table, "saturation"),
        gear_ratio=_plain_number(table, "gear_ratio"),
        flux_from=flux_from,
        entries=entries,
    )


def parse_quantity(name: str, text: object) -> float:
    """A number with its unit in SI, e.g. ``"95 mohm"``; blanks, dots, capitals, Ω, µ, ² do not matter."""
    match = _NUMBER.fullmatch(text) if isinstance(text, str) and len(text) <= _LONGEST_TEXT else None
    value = float(match[1]) * unit_factor(ENTRIES[name].units, match[2]) if match else math.nan
    if not math.isfinite(value):
        point = "; decimals stand behind a point" if isinstance(text, str) and "," in text else ""
        allowed = f"write a number and its unit: {', '.join(ENTRIES[name].units)}{point}"
        raise InvalidValueError(name, text, allowed)
    return value


def datasheet_template() -> str:
    """A blank sheet: every entry as a remark, with its units and the words to choose from."""
    lines = [
        "# A data sheet: take the # off what the maker prints, fill in the numbers, choose the conventions.",
        "[datasheet]",
        'name = ""',
        'source = ""',
        "pole_pairs = 21  # or poles, the count of magnets",
        '# connection = "star"  # star, delta: needed where a value is a phase\'s',
        *(f"# {_template_line(name, kind)}" for name, kind in ENTRIES.items()),
        "# saturation = 0.1  # share of the torque lost at the peak current",
        "# gear_ratio = 6.0  # where a value is taken at the output",
        '# flux_from = "kv"  # the entry to trust where entries contradict each other',
    ]
    return "\n".join(lines) + "\n"


def _template_line(name: str, kind: EntryKind) -> str:
    value, remark = f'"0 {next(iter(kind.units))}"', ", ".join(kind.units)
    if kind.key:
        remark += f"; {kind.key}: {', '.join(kind.words)}"
        value = f'{{ value = {value}, {kind.key} = "?" }}'
    if kind.sided:
        remark += '; at = "output" behind a gear'
    return f"{name} = {value}  # {remark}"


def _entry(name: str, written: Any) -> Entry:
    """One entry from a text, or from a table with ``value``, its convention and its side of the gear."""
    kind = ENTRIES[name]
    table: Mapping[str, Any] = cast("Any", written) if isinstance(written, dict) else {"value": written}
    words = ({kind.key: kind.words} if kind.key else {}) | ({"at": SIDES} if kind.sided else {})
    for key, value in table.items():
        if key not in ("value", *words):
            known = ", ".join(sorted(("value", *words)))
            raise InvalidValueError(f"{name}.{key}", value, f"unknown; choose among {known}")
        if key != "value" and value not in words[key]:
            raise InvalidValueError(f"{name}.{key}", value, "choose one of: " + ", ".join(words[key]))
    value = parse_quantity(name, table.get("value"))
    if value < 0 or (value == 0 and kind.units is not units.HENRY):
        raise InvalidValueError(name, table["value"], "must be greater than 0")
    convention = str(table.get(kind.key, ""))
    ambiguous = () if convention else kind.words
    return Entry(name, str(table["value"]), value, convention, ambiguous, table.get("at") == "output")


def _pole_pairs(table: Mapping[str, Any]) -> int:
    """Pole pairs from either count; both must agree, and the count of poles must be even."""
    poles, pairs = table.get("poles"), table.get("pole_pairs")
    for key, value in (("poles", poles), ("pole_pairs", pairs)):
        if value is not None and (type(value) is not int or value < 1):
            raise InvalidValueError(key, value, "must be a whole number of at least 1")
    if poles is None and pairs is None:
        raise MissingValueError("poles", "give poles (magnets) or pole_pairs (half of them)")
    if poles is not None and poles % 2:
        raise InvalidValueError("poles", poles, "must be even; if it counts pairs, write pole_pairs")
    if poles is not None and pairs is not None and poles != 2 * pairs:
        raise InvalidValueError("poles", poles, f"contradicts pole_pairs = {pairs}: must be {2 * pairs}")
    return int(pairs if pairs is not None else cast("int", poles) // 2)


def _plain_number(table: Mapping[str, Any], key: str) -> float | None:
    value = table.get(key)
    if value is not None and type(value) not in (int, float):
        raise InvalidValueError(key, value, "must be a plain number")
    return None if value is None else float(value)
