"""From a data sheet to dq parameters, every conversion written out, nothing guessed.

The target is the star-equivalent motor with amplitude-invariant dq quantities: whatever the real connection,
three line terminals cannot tell a delta winding from a star winding of a third of its resistance and
inductance and ``1 / sqrt(3)`` of its flux. With ``e = N psi omega`` the amplitude of the star's phase EMF and
``i`` the amplitude of the line current, ``tau = 1.5 N psi i``:

========================  =======================  ================================
a voltage given as        is so many times ``e``   note
========================  =======================  ================================
line-to-line amplitude    sqrt(3)
line-to-line rms          sqrt(3) / sqrt(2)
phase amplitude           1 (star), sqrt(3) (delta)  a delta winding sees two lines
phase rms                 the same / sqrt(2)
dc                        sqrt(3)                  six-step drive: two lines on the bus
========================  =======================  ================================

A current given as line amplitude, line rms, phase amplitude, phase rms or dc stands for ``i`` equal to 1,
sqrt(2), 1 or sqrt(3), sqrt(2) times that, and 2 / sqrt(3) times itself; the last one is the DC current of a
six-step drive that gives the same torque.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import tomli_w

from sprintlab.core.checks import check_range
from sprintlab.core.errors import InvalidValueError, SprintlabError, printable
from sprintlab.core.files import atomic_write_text
from sprintlab.motors.files import SupplyFile, save_supply, table_of
from sprintlab.motors.parameters import PmsmParameters
from sprintlab.motors.saturation import desaturate
from sprintlab.motors.thermal import HousedHeat, I2tLimit
from sprintlab.workbench.datasheet_file import ENTRIES, Datasheet, Entry

FLUX_ENTRIES = ("flux_linkage", "back_emf_constant", "kv", "torque_constant")
"""Entries that give the flux linkage, in the order of preference."""
TOLERANCE = 0.05
"""Difference between entries that say the same, taken for rounding [-]."""

_RATED_TOLERANCE = 0.15  # rated values are warm and rounded
_GEAR_TOLERANCE = 0.25  # of a ratio of torques to the gear ratio: efficiency and saturation are in it
_NO_LOAD_RANGE = (0.85, 1.2)  # no-load speed over V_bus / (sqrt(3) N psi), six-step to sine drives
_VOLTAGE_READINGS = ("line-to-line amplitude", "line-to-line rms", "phase amplitude", "phase rms")
_READINGS = {
    "kv": _VOLTAGE_READINGS,
    "back_emf_constant": _VOLTAGE_READINGS,
    "torque_constant": ("line amplitude", "line rms", "dc"),
}  # conventions that a hint tries; those that equal one of these are left out
_THERMAL_ENTRIES = ("thermal_resistance", "time_constant")
_DELTA = math.sqrt(3.0)
_ROUNDING = 5e-3  # a negative saturation of this size is not worth a word


@dataclass(frozen=True, kw_only=True)
class ConversionStep:
    """One line of the calculation."""

    quantity: str
    """What is computed, with the entry it comes from."""
    formula: str
    """In symbols."""
    numbers: str
    """The same with the sheet's numbers."""
    value: float
    """The result, SI."""
    unit: str
    """Its unit."""

    def __str__(self) -> str:
        """``quantity: formula = numbers = value unit``; the value is not said twice."""
        value = f"{self.value:.5g}"
        parts = [self.formula, *([self.numbers] if self.numbers != value else []), value]
        return f"{self.quantity}: {' = '.join(parts)} {self.unit}".rstrip()


@dataclass(frozen=True, kw_only=True)
class DatasheetConversion:
    """A motor, how it was computed, and what remains to be said."""

    motor: PmsmParameters
    """dq parameters."""
    i2t: I2tLimit | None
    """From the rated current or torque with a peak duration or thermal time constant; ``None`` without."""
    heat: HousedHeat | None
    """From two thermal resistances and two time constants; ``None`` without all of them."""
    steps: tuple[ConversionStep, ...]
    """In the order of the calculation."""
    notes: tuple[str, ...]
    """What the sheet leaves open, and where it disagrees with itself within bounds."""


def convert_datasheet(sheet: Datasheet, tolerance: float = TOLERANCE) -> DatasheetConversion:
    """The dq parameters of a data sheet.

    Args:
        sheet: as read by ``load_datasheet``.
        tolerance: relative difference between entries that say the same, in (0, 0.5).

    Raises:
        SprintlabError: entries are ambiguous; all are named, with what each convention would mean.
        InvalidValueError: an entry is missing or contradicts another; both are named, with the conventions
            under which they would agree.
    """
    check_range("tolerance", tolerance, 1e-6, 0.5)
    return _Conversion(sheet, tolerance).run()


def save_converted_motor(
    conversion: DatasheetConversion, sheet: Datasheet, path: str | os.PathLike[str]
) -> None:
    """Write the motor as TOML with the calculation as comments; ``load_motor`` reads it.

    Raises:
        SprintlabError: the file cannot be written.
    """
    lines = [f"{sheet.name or 'Motor'}, from its data sheet", *([sheet.source] if sheet.source else []), ""]
    lines += [str(step) for step in conversion.steps]
    lines += [f"note: {note}" for note in conversion.notes]
    comment = "".join(f"# {printable(' '.join(line.split()))}".rstrip() + "\n" for line in lines)
    table = asdict(conversion.motor)
    atomic_write_text(path, comment + "\n" + tomli_w.dumps({"motor": table}))


def save_converted_supply(conversion: DatasheetConversion, path: str | os.PathLike[str]) -> None:
    """Write the drive's I²t and the motor's heat as a supply file; ``load_supply`` reads it.

    Raises:
        InvalidValueError: the sheet gives neither.
        SprintlabError: the file cannot be written.
    """
    if conversion.i2t is None and conversion.heat is None:
        allowed = "is missing: give it or winding_time_constant, beside rated_current or rated_torque"
        raise InvalidValueError("datasheet.peak_duration", None, allowed)
    save_supply(SupplyFile(battery=None, heat=conversion.heat, i2t=conversion.i2t), path)


def voltage_factor(convention: str, connection: str) -> float:
    """A voltage of this convention over the amplitude of the star's phase EMF [-]."""
    lines = convention.startswith("line-to-line") or convention == "dc" or connection == "delta"
    return (_DELTA if lines else 1.0) / (math.sqrt(2.0) if convention.endswith("rms") else 1.0)


def current_factor(convention: str, connection: str) -> float:
    """Amplitude of the line current over a current of this convention [-]."""
    if convention == "dc":
        return 2.0 / math.sqrt(3.0)
    winding = convention.startswith("phase") and connection == "delta"
    return (_DELTA if winding else 1.0) * (math.sqrt(2.0) if convention.endswith("rms") else 1.0)


def impedance_factor(convention: str, connection: str) -> float:
    """Star-phase resistance or inductance over one measured so [-]."""
    if convention == "lines":
        return 0.5
    return 1.0 / 3.0 if connection == "delta" else 1.0


class _Conversion:
    """The calculation; keeps its steps and notes while it goes."""

    def __init__(self, sheet: Datasheet, tolerance: float) -> None:
        self._sheet = sheet
        self._tolerance = tolerance
        self._steps: list[ConversionStep] = []
        self._notes: list[str] = []

    def run(self) -> DatasheetConversion:
        self._refuse_ambiguous()
        pairs = self._sheet.pole_pairs
        self._step("pole pairs", "N", f"{pairs}", float(pairs), "")
        resistance = self._impedance("R", "resistance", "ohm")
        inductance = self._q_axis_inductance()
        flux = self._flux()
        constant = 1.5 * pairs * flux
        self._step(
            "torque constant", "1.5 N psi", f"1.5 x {pairs} x {flux:.5g}", constant, "N m/A (amplitude)"
        )
        peak_torque, saturation = self._peak(constant)
        self._check_rated(constant)
        self._check_no_load(flux)
        motor = PmsmParameters(
            pole_pairs=pairs,
            stator_resistance=resistance,
            q_axis_inductance=inductance,
            flux_linkage=flux,
            peak_torque=peak_torque,
            saturation=saturation,
            rotor_inertia=self._needed(
                "rotor_inertia",
                "if the sheet has none, measure it or estimate mass x radius^2 of the rotor's ring",
            ).value,
        )
        i2t = self._i2t(motor)
        heat = self._heat()
        return DatasheetConversion(
            motor=motor, i2t=i2t, heat=heat, steps=tuple(self._steps), notes=tuple(self._notes)
        )

    def _step(self, quantity: str, formula: str, numbers: str, value: float, unit: str) -> float:
        step = ConversionStep(quantity=quantity, formula=formula, numbers=numbers, value=value, unit=unit)
        if step not in self._steps:
            self._steps.append(step)
        return value

    def _needed(self, name: str, hint: str) -> Entry:
        entry = self._sheet.entries.get(name)
        if entry is None:
            raise InvalidValueError(f"datasheet.{name}", None, f"is missing: {hint}")
        return entry

    def _refuse_ambiguous(self) -> None:
        """Name every entry whose convention is missing, how to write it, and what each reading would mean."""
        unclear = [self._ambiguity(entry) for entry in self._sheet.entries.values() if entry.ambiguous]
        unclear += [
            f"{entry.name} is given for a phase, so connection must say star or delta"
            for entry in self._sheet.entries.values()
            if entry.convention.startswith("phase") and not self._sheet.connection
        ]
        if unclear:
            raise SprintlabError("the data sheet is ambiguous: " + "; ".join(unclear))

    def _ambiguity(self, entry: Entry) -> str:
        readings = [f"'{word}'{self._reading(entry, word)}" for word in entry.ambiguous]
        key = next(iter(ENTRIES[entry.name].conventions))
        return f"{entry.name} = '{entry.text}' does not say which: {key} = {', '.join(readings)}"

    def _reading(self, entry: Entry, word: str) -> str:
        """What a convention would mean for the flux, and which clear entries say the same."""
        flux = self._flux_of(entry, word)
        if flux is None:
            return ""
        others = [
            other.name
            for other in self._sheet.entries.values()
            if not other.ambiguous
            and (value := self._flux_of(other, other.convention)) is not None
            and _agree(value, flux, self._tolerance)
        ]
        agrees = f", as {' and '.join(others)}" if others else ""
        return f" (psi = {flux * 1e3:.4g} mWb{agrees})"

    def _impedance(self, symbol: str, name: str, unit: str) -> float:
        entry = self._needed(name, "between two lines or of one phase")
        factor = impedance_factor(entry.convention, self._sheet.connection)
        divisor = round(1.0 / factor)
        formula = f"{symbol}_{entry.convention}" + (f" / {divisor}" if divisor > 1 else "")
        numbers = f"{entry.value:.5g}" + (f" / {divisor}" if divisor > 1 else "")
        return self._step(
            f"{symbol} from {name} ({entry.convention})", formula, numbers, factor * entry.value, unit
        )

    def _q_axis_inductance(self) -> float:
        direct = self._sheet.entries.get("q_axis_inductance")
        if direct is None:
            if "inductance" not in self._sheet.entries:
                self._needed(
                    "inductance", "without it the d-axis voltage is unknown; 0 H leaves it out on purpose"
                )
            inductance = self._impedance("L", "inductance", "H")
            self._notes.append("L stands for both axes: a salient rotor needs q_axis_inductance")
            return inductance
        self._step("L from q_axis_inductance", "L_q", f"{direct.value:.5g}", direct.value, "H")
        if "inductance" in self._sheet.entries:
            other = self._impedance("L", "inductance", "H")
            if not _agree(other, direct.value, self._tolerance):
                self._notes.append(
                    f"inductance gives {other:.4g} H a phase, q_axis_inductance {direct.value:.4g} H: "
                    "the latter is used"
                )
        return direct.value

    def _flux(self) -> float:
        """The flux linkage from every entry that gives it; they must agree."""
        found = [self._sheet.entries[name] for name in FLUX_ENTRIES if name in self._sheet.entries]
        if not found:
            raise InvalidValueError(
                "datasheet.kv", None, "is missing: give one of " + ", ".join(FLUX_ENTRIES)
            )
        values = {entry.name: self._flux_step(entry) for entry in found}
        chosen = self._sheet.flux_from or found[0].name
        if chosen not in values:
            raise InvalidValueError("datasheet.flux_from", chosen, "choose one of " + ", ".join(values))
        for entry in found:
            if not _agree(values[entry.name], values[chosen], self._tolerance):
                self._contradiction(entry, values[entry.name], chosen, values[chosen])
        return self._step(f"psi, taken from {chosen}", "psi", f"{values[chosen]:.5g}", values[chosen], "Wb")

    def _contradiction(self, entry: Entry, value: float, chosen: str, reference: float) -> None:
        """Refuse, naming both and what would make them agree; a note if the sheet says which one to trust."""
        other = self._sheet.entries[chosen]
        said = (
            f"gives psi = {value * 1e3:.4g} mWb, {chosen} = '{other.text}' gives {reference * 1e3:.4g} mWb "
            f"({value / reference - 1.0:+.1%})"
        )
        if self._sheet.flux_from:
            self._notes.append(f"{entry.name} = '{entry.text}' {said}: the sheet trusts {chosen}")
            return
        readings = self._agreeing(entry, reference) + self._agreeing(other, value)
        readings = readings or self._agreeing_together(entry, other)
        hint = f"; they agree if {' or if '.join(readings)}" if readings else ""
        raise InvalidValueError(
            f"datasheet.{entry.name}",
            f"{entry.text}, {entry.convention}".rstrip(", "),
            f"{said}{hint}; correct one, or set flux_from to the one to trust",
        )

    def _agreeing(self, entry: Entry, reference: float) -> list[str]:
        """Other conventions of ``entry`` that give the reference flux."""
        found: list[str] = []
        for word in _READINGS.get(entry.name, ()):
            flux = self._flux_of(entry, word)
            if word != entry.convention and flux and _agree(flux, reference, self._tolerance):
                found.append(f"{entry.name} is '{word}'")
        return found

    def _agreeing_together(self, entry: Entry, other: Entry) -> list[str]:
        """Conventions of both entries, each other than the one given, under which they agree."""
        return [
            f"{other.name} is '{word}' and {reading}"
            for word in _READINGS.get(other.name, ())
            if word != other.convention and (flux := self._flux_of(other, word))
            for reading in self._agreeing(entry, flux)
        ]

    def _flux_of(self, entry: Entry, convention: str) -> float | None:
        """The flux linkage if ``entry`` followed ``convention`` [Wb]; ``None`` if it gives none."""
        pairs, connection = self._sheet.pole_pairs, self._sheet.connection
        laws: dict[str, Callable[[], float]] = {
            "flux_linkage": lambda: entry.value,
            "back_emf_constant": lambda: (
                self._motor_side(entry) / (voltage_factor(convention, connection) * pairs)
            ),
            "kv": lambda: 1.0 / (self._motor_side(entry) * voltage_factor(convention, connection) * pairs),
            "torque_constant": lambda: (
                self._motor_side(entry) / (1.5 * current_factor(convention, connection) * pairs)
            ),
        }
        law = laws.get(entry.name)
        return law() if law else None

    def _flux_step(self, entry: Entry) -> float:
        """Write one way to the flux out."""
        pairs, value = self._sheet.pole_pairs, self._motor_side(entry)
        across = voltage_factor(entry.convention, self._sheet.connection)
        through = current_factor(entry.convention, self._sheet.connection)
        shown: dict[str, tuple[str, str]] = {
            "flux_linkage": ("psi", f"{value:.5g}"),
            "back_emf_constant": ("K_e / (c N)", f"{value:.5g} / ({across:.4g} x {pairs})"),
            "kv": ("1 / (K_v c N)", f"1 / ({value:.5g} rad/s/V x {across:.4g} x {pairs})"),
            "torque_constant": (
                "K_t / (1.5 c N)",
                f"{value:.5g} / (1.5 x {through:.4g} x {pairs})",
            ),
        }
        formula, numbers = shown[entry.name]
        said = f" ({entry.convention})" if entry.convention else ""
        flux = self._flux_of(entry, entry.convention) or 0.0
        return self._step(f"psi from {entry.name}{said}", formula, numbers, flux, "Wb")

    def _peak(self, constant: float) -> tuple[float, float]:
        """Peak torque before saturation, and the saturation that the sheet implies."""
        current, torque = self._sheet.entries.get("peak_current"), self._sheet.entries.get("peak_torque")
        if current is not None:
            before = self._peak_from_current(current, constant)
            delivered = None if torque is None else self._motor_side(torque)
            return before, self._saturation(before, delivered)
        if torque is None:
            raise InvalidValueError(
                "datasheet.peak_current",
                None,
                "is missing: give peak_current or peak_torque, the drive's limit",
            )
        alpha = self._stated_saturation() or 0.0
        before = self._motor_side(torque) / (1.0 - alpha)
        numbers = f"{self._motor_side(torque):.5g} / (1 - {alpha:.3g})"
        return self._step("peak torque before saturation", "tau / (1 - alpha)", numbers, before, "N m"), alpha

    def _peak_from_current(self, entry: Entry, constant: float) -> float:
        amplitude = self._amplitude(entry)
        numbers = f"{constant:.5g} x {amplitude:.5g}"
        return self._step(
            "peak torque before saturation", "1.5 N psi i_peak", numbers, constant * amplitude, "N m"
        )

    def _amplitude(self, entry: Entry) -> float:
        factor = current_factor(entry.convention, self._sheet.connection)
        numbers = f"{factor:.4g} x {entry.value:.5g}"
        return self._step(
            f"{entry.name} ({entry.convention})", "c i", numbers, factor * entry.value, "A (amplitude)"
        )

    def _saturation(self, before: float, delivered: float | None) -> float:
        stated = (
            self._stated_saturation() if delivered is None or self._sheet.saturation is not None else None
        )
        if delivered is None:
            return stated or 0.0
        implied = 1.0 - delivered / before
        numbers = f"1 - {delivered:.5g} / {before:.5g}"
        self._step("saturation from peak_torque", "1 - tau / (1.5 N psi i_peak)", numbers, implied, "")
        if implied < -self._tolerance or implied >= 0.5:
            self._peak_contradiction(delivered, before, implied)
        if stated is not None:
            if abs(stated - max(implied, 0.0)) > self._tolerance:
                self._notes.append(
                    f"peak_torque implies a saturation of {implied:.3f}, the stated {stated:g} is used"
                )
            return stated
        if implied < -_ROUNDING:
            self._notes.append(
                f"peak_torque lies {-implied:.1%} above 1.5 N psi i_peak: saturation taken as 0"
            )
        return max(implied, 0.0)

    def _peak_contradiction(self, delivered: float, before: float, implied: float) -> None:
        entry = self._sheet.entries["peak_current"]
        amplitude = before / (entry.value * current_factor(entry.convention, self._sheet.connection))
        readings: list[str] = []
        for word in ("line amplitude", "line rms", "dc"):
            alpha = 1.0 - delivered / (amplitude * entry.value * current_factor(word, ""))
            if word != entry.convention and -self._tolerance <= alpha < 0.35:
                readings.append(f"'{word}' (saturation {max(alpha, 0.0):.2f})")
        hint = f"; possible if peak_current is {' or '.join(readings)}" if readings else ""
        ratio = self._sheet.gear_ratio
        if ratio and _agree(delivered / before, ratio, _GEAR_TOLERANCE):
            hint += (
                f"; the two differ by the gear's ratio of {ratio:g}: write at = 'output' beside peak_torque"
            )
        elif implied < 0.0 or not readings:
            hint += "; is peak_current the current at the supply? The phase current is needed"
        raise InvalidValueError(
            "datasheet.peak_torque",
            self._sheet.entries["peak_torque"].text,
            f"contradicts peak_current = '{entry.text}', {entry.convention}: the torque constant gives "
            f"{before:.4g} N m, so that the saturation would be {implied:.2f}{hint}",
        )

    def _stated_saturation(self) -> float | None:
        if self._sheet.saturation is None:
            self._notes.append(
                "the sheet says nothing of saturation: taken as 0, measure it (motor identify)"
            )
            return None
        value = self._sheet.saturation
        check_range("datasheet.saturation", value, 0.0, 0.499)
        return self._step("saturation as stated", "alpha", f"{value:g}", value, "")

    def _motor_side(self, entry: Entry) -> float:
        """An entry as it is before the gear: speeds are higher there, torques lower."""
        if not entry.at_output:
            return entry.value
        ratio = self._sheet.gear_ratio
        if ratio is None:
            raise InvalidValueError(
                f"datasheet.{entry.name}", "at = 'output'", "the sheet must give gear_ratio, a plain number"
            )
        check_range("datasheet.gear_ratio", ratio, 1.0, 500.0)
        return entry.value * ratio if entry.name in ("no_load_speed", "kv") else entry.value / ratio

    def _i2t(self, motor: PmsmParameters) -> I2tLimit | None:
        """Continuous current, and how long the peak current may flow."""
        entries = self._sheet.entries
        durations = [name for name in ("peak_duration", "winding_time_constant") if name in entries]
        continuous = self._continuous_current(motor) if durations else None
        if continuous is None:
            return None
        share = (continuous * motor.torque_constant / motor.peak_torque) ** 2
        if share >= 1.0:
            name = "rated_current" if "rated_current" in entries else "rated_torque"
            allowed = f"needs {continuous:.4g} A (amplitude), no less than the peak current"
            raise InvalidValueError(f"datasheet.{name}", entries[name].text, allowed)
        given = entries[durations[0]].value
        if durations[0] == "winding_time_constant":
            numbers, lasts = f"-{given:g} ln(1 - {share:.4g})", -given * math.log(1.0 - share)
            self._step("peak duration from cold", "-T ln(1 - (i_c / i_peak)^2)", numbers, lasts, "s")
            return I2tLimit(continuous_current=continuous, time_constant=given)
        return I2tLimit(continuous_current=continuous, peak_duration=given)

    def _heat(self) -> HousedHeat | None:
        """Both thermal nodes; a time constant is a node's heat capacity times its resistance outward."""
        entries = self._sheet.entries
        if not all(
            f"{node}_{name}" in entries for node in ("winding", "housing") for name in _THERMAL_ENTRIES
        ):
            return None
        capacity: dict[str, float] = {}
        for node in ("winding", "housing"):
            resistance, constant = (entries[f"{node}_{name}"].value for name in _THERMAL_ENTRIES)
            numbers = f"{constant:g} / {resistance:g}"
            capacity[node] = self._step(
                f"heat capacity, {node}", "T / R_th", numbers, constant / resistance, "J/K"
            )
        return HousedHeat(
            heat_capacity=capacity["winding"],
            thermal_resistance=entries["winding_thermal_resistance"].value,
            housing_heat_capacity=capacity["housing"],
            housing_thermal_resistance=entries["housing_thermal_resistance"].value,
        )

    def _continuous_current(self, motor: PmsmParameters) -> float | None:
        """Amplitude of the rated current [A], or of the one that the rated torque needs."""
        entries = self._sheet.entries
        if "rated_current" in entries:
            return self._amplitude(entries["rated_current"])
        if "rated_torque" not in entries:
            return None
        torque = self._motor_side(entries["rated_torque"])
        current = float(desaturate(motor, torque)) / motor.torque_constant
        numbers = f"{torque:.5g} / {motor.torque_constant:.5g}"
        return self._step("continuous current from rated_torque", "tau / (1.5 N psi)", numbers, current, "A")

    def _check_rated(self, constant: float) -> None:
        current, torque = self._sheet.entries.get("rated_current"), self._sheet.entries.get("rated_torque")
        if current is None or torque is None:
            return
        expected = constant * self._amplitude(current)
        given = self._motor_side(torque)
        if not _agree(given, expected, _RATED_TOLERANCE):
            ratio = self._sheet.gear_ratio
            geared = bool(ratio) and _agree(given / expected, float(ratio or 1.0), _GEAR_TOLERANCE)
            cause = (
                f"that is the gear's ratio, {ratio:g}: write at = 'output'"
                if geared
                else "one of the two follows another convention"
            )
            self._notes.append(
                f"rated_torque is {given:.4g} N m, torque constant and rated_current give {expected:.4g} N m "
                f"({given / expected - 1.0:+.0%}): {cause}"
            )

    def _check_no_load(self, flux: float) -> None:
        speed, voltage = (self._sheet.entries.get(name) for name in ("no_load_speed", "no_load_voltage"))
        if speed is None:
            return
        if voltage is None:
            raise InvalidValueError(
                "datasheet.no_load_voltage", None, "no_load_speed needs the bus voltage it was taken at"
            )
        expected = voltage.value / (math.sqrt(3.0) * self._sheet.pole_pairs * flux)
        ratio = self._motor_side(speed) / expected
        if not _NO_LOAD_RANGE[0] <= ratio <= _NO_LOAD_RANGE[1]:
            self._notes.append(
                f"no_load_speed is {ratio:.2f} times V / (sqrt(3) N psi) = {expected:.4g} rad/s: check the "
                "flux, the pole count and the voltage"
            )


def _agree(first: float, second: float, tolerance: float) -> bool:
    return abs(first - second) <= tolerance * max(abs(first), abs(second))


def conversion_numbers(conversion: DatasheetConversion) -> dict[str, Any]:
    """Parameters, steps and notes, ready for JSON."""
    motor = conversion.motor
    return {
        "motor": asdict(motor),
        "torque_constant": motor.torque_constant,
        "i2t": None if conversion.i2t is None else table_of(conversion.i2t),
        "heat": None if conversion.heat is None else table_of(conversion.heat),
        "steps": [asdict(step) for step in conversion.steps],
        "notes": list(conversion.notes),
    }
