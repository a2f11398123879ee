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
from sprintlab.core.errors import InvalidValueError, MissingValueError, SprintlabError, printable
from sprintlab.core.files import atomic_write_text
from sprintlab.motors.files import SupplyFile, save_supply, table_of
from sprintlab.motors.parameters import PmsmParameters
from sprintlab.motors.saturation import desaturate
from sprintlab.motors.thermal import HousedHeat, I2tLimit
from sprintlab.workbench.datasheet_file import ENTRIES, Datasheet, Entry

_TOLERANCE = 0.05  # relative, of entries that say the same: rounding
_RATED_TOLERANCE = 0.15  # rated values are warm and rounded
_GEAR_TOLERANCE = 0.25  # relative, of gear and torque ratios: losses and saturation are in it
_NO_LOAD_RANGE = (0.85, 1.2)  # no-load speed over V_bus / (sqrt(3) N psi), six-step to sine drives
_VOLTAGE_READINGS = ("line-to-line amplitude", "line-to-line rms", "phase amplitude", "phase rms")
_CURRENT_READINGS = ("line amplitude", "line rms", "dc")
_READINGS = {
    "kv": _VOLTAGE_READINGS, "back_emf_constant": _VOLTAGE_READINGS, "torque_constant": _CURRENT_READINGS,
}  # conventions that a hint tries; those that equal one of these are left out  # fmt: skip
_DELTA = math.sqrt(3.0)
_ROUNDING = 5e-3  # a negative saturation of this size is not worth a word
_FLUX_LAWS: dict[str, tuple[Callable[[float, float, int], float], str, str]] = {
    # entry: psi of its value v, its convention's factor c and N; the same in symbols, and with numbers
    "flux_linkage": (lambda v, c, n: v, "psi", "{v:.5g}"),
    "back_emf_constant": (lambda v, c, n: v / (c * n), "K_e / (c N)", "{v:.5g} / ({c:.4g} x {n})"),
    "kv": (lambda v, c, n: 1.0 / (v * c * n), "1 / (K_v c N)", "1 / ({v:.5g} rad/s/V x {c:.4g} x {n})"),
    "torque_constant": (
        lambda v, c, n: v / (1.5 * c * n), "K_t / (1.5 c N)", "{v:.5g} / (1.5 x {c:.4g} x {n})",
    ),
}  # in the order of preference  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class ConversionStep:
    """One line of the calculation."""

    quantity: str  # that is computed, with the entry it comes from
    formula: str  # in symbols
    numbers: str  # the same with the sheet's numbers
    value: float  # the result, SI
    unit: str

    def __str__(self) -> str:
        """``quantity: formula = numbers = value unit``; the value is not said twice."""
        value = f"{self.value:.5g}"
        parts = [self.formula, *([self.numbers] if self.numbers != value else []), value]
        return f"{self.quantity}: {' = '.join(parts)} {self.unit}".rstrip()


@dataclass(frozen=True, kw_only=True)
class DatasheetConversion:
    """A motor, how it was computed, and what remains to be said."""

    motor: PmsmParameters  # dq parameters
    i2t: I2tLimit | None
    """From the rated current or torque with a peak duration or thermal time constant; ``None`` without."""
    heat: HousedHeat | None
    """From two thermal resistances and two time constants; ``None`` without all of them."""
    steps: tuple[ConversionStep, ...]  # In the order of the calculation
    notes: tuple[str, ...]  # What the sheet leaves open, and where it disagrees with itself within bounds


def convert_datasheet(sheet: Datasheet) -> DatasheetConversion:
    """The dq parameters of a data sheet, whose entries may differ by 5 % where they say the same.

    Raises:
        SprintlabError: entries are ambiguous; all are named, with what each convention would mean.
        InvalidValueError: an entry is missing or contradicts another; both are named, with the conventions
            under which they would agree.
    """
    return _Conversion(sheet).run()


def save_converted_motor(
    conversion: DatasheetConversion, sheet: Datasheet, path: str | os.PathLike[str]
) -> None:
    """Write the motor as TOML with the calculation as comments; ``load_motor`` reads it."""
    lines = [f"{sheet.name or 'Motor'}, from its data sheet", *([sheet.source] if sheet.source else []), ""]
    lines += [str(step) for step in conversion.steps]
    lines += [f"note: {note}" for note in conversion.notes]
    comment = "".join(f"# {printable(' '.join(line.split()))}".rstrip() + "\n" for line in lines)
    table = asdict(conversion.motor)
    atomic_write_text(path, comment + "\n" + tomli_w.dumps({"motor": table}))


def save_converted_supply(conversion: DatasheetConversion, path: str | os.PathLike[str]) -> None:
    """Write the drive's I²t and the motor's heat as a supply file; ``load_supply`` reads it."""
    if conversion.i2t is None and conversion.heat is None:
        allowed = "give it or winding_time_constant, beside rated_current or rated_torque"
        raise MissingValueError("datasheet.peak_duration", allowed)
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

    def __init__(self, sheet: Datasheet) -> None:
        self._sheet, self._entries = sheet, sheet.entries
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
        unit = "N m/A (amplitude)"
        self._step("torque constant", "1.5 N psi", f"1.5 x {pairs} x {flux:.5g}", constant, unit)
        peak_torque, saturation = self._peak(constant)
        self._check_rated(constant)
        self._check_no_load(flux)
        hint = "if the sheet has none, measure it or estimate mass x radius^2 of the rotor's ring"
        motor = PmsmParameters(
            pole_pairs=pairs,
            stator_resistance=resistance,
            q_axis_inductance=inductance,
            flux_linkage=flux,
            peak_torque=peak_torque,
            saturation=saturation,
            rotor_inertia=self._needed("rotor_inertia", hint).value,
        )
        i2t, heat = self._i2t(motor), self._heat()
        return DatasheetConversion(
            motor=motor, i2t=i2t, heat=heat, steps=tuple(self._steps), notes=tuple(self._notes)
        )

    def _step(self, quantity: str, formula: str, numbers: str, value: float, unit: str) -> float:
        step = ConversionStep(quantity=quantity, formula=formula, numbers=numbers, value=value, unit=unit)
        if step not in self._steps:
            self._steps.append(step)
        return value

    def _needed(self, name: str, hint: str) -> Entry:
        if name not in self._entries:
            raise MissingValueError(f"datasheet.{name}", hint)
        return self._entries[name]

    def _refuse_ambiguous(self) -> None:
        """Name every entry whose convention is missing, how to write it, and what each reading would mean."""
        entries = self._entries.values()
        unclear = [self._ambiguity(entry) for entry in entries if entry.ambiguous]
        unclear += [
            f"{entry.name} is given for a phase, so connection must say star or delta"
            for entry in entries
            if entry.convention.startswith("phase") and not self._sheet.connection
        ]
        if unclear:
            raise SprintlabError("the data sheet is ambiguous: " + "; ".join(unclear))

    def _ambiguity(self, entry: Entry) -> str:
        readings = [f"'{word}'{self._reading(entry, word)}" for word in entry.ambiguous]
        key = ENTRIES[entry.name].key
        return f"{entry.name} = '{entry.text}' does not say which: {key} = {', '.join(readings)}"

    def _reading(self, entry: Entry, word: str) -> str:
        """What a convention would mean for the flux, and which clear entries say the same."""
        if entry.name not in _FLUX_LAWS:
            return ""
        flux = self._flux_of(entry, word)
        others = [
            other.name
            for other in self._entries.values()
            if other.name in _FLUX_LAWS
            and not other.ambiguous
            and _agree(self._flux_of(other, other.convention), flux)
        ]
        agrees = f", as {' and '.join(others)}" if others else ""
        return f" (psi = {flux * 1e3:.4g} mWb{agrees})"

    def _impedance(self, symbol: str, name: str, unit: str) -> float:
        entry = self._needed(name, "between two lines or of one phase")
        factor = impedance_factor(entry.convention, self._sheet.connection)
        divided = f" / {round(1.0 / factor)}" if factor < 1.0 else ""
        formula, numbers = f"{symbol}_{entry.convention}{divided}", f"{entry.value:.5g}{divided}"
        return self._step(
            f"{symbol} from {name} ({entry.convention})", formula, numbers, factor * entry.value, unit
        )

    def _q_axis_inductance(self) -> float:
        direct = self._entries.get("q_axis_inductance")
        if direct is not None:
            return self._step("L from q_axis_inductance", "L_q", f"{direct.value:.5g}", direct.value, "H")
        self._needed("inductance", "without it the d-axis voltage is unknown; 0 H leaves it out on purpose")
        self._notes.append("L stands for both axes: a salient rotor needs q_axis_inductance")
        return self._impedance("L", "inductance", "H")

    def _flux(self) -> float:
        """The flux linkage from every entry that gives it; they must agree."""
        found = [self._entries[name] for name in _FLUX_LAWS if name in self._entries]
        if not found:
            raise MissingValueError("datasheet.kv", "give one of " + ", ".join(_FLUX_LAWS))
        values = {entry.name: self._flux_step(entry) for entry in found}
        chosen = self._sheet.flux_from or found[0].name
        if chosen not in values:
            raise InvalidValueError("datasheet.flux_from", chosen, "choose one of " + ", ".join(values))
        for entry in found:
            if not _agree(values[entry.name], values[chosen]):
                self._contradiction(entry, values[entry.name], chosen, values[chosen])
        return self._step(f"psi, taken from {chosen}", "psi", f"{values[chosen]:.5g}", values[chosen], "Wb")

    def _contradiction(self, entry: Entry, value: float, chosen: str, reference: float) -> None:
        """Refuse, naming both and what would make them agree; a note if the sheet says which one to trust."""
        other = self._entries[chosen]
        said = (
            f"gives psi = {value * 1e3:.4g} mWb, {chosen} = '{other.text}' gives {reference * 1e3:.4g} mWb "
            f"({value / reference - 1.0:+.1%})"
        )
        if self._sheet.flux_from:
            self._notes.append(f"{entry.name} = '{entry.text}' {said}: the sheet trusts {chosen}")
            return
        readings = self._agreeing(entry, reference) + self._agreeing(other, value)
        readings = readings or [
            f"{other.name} is '{word}' and {reading}"
            for word, flux in self._other_readings(other)
            for reading in self._agreeing(entry, flux)
        ]
        hint = f"; they agree if {' or if '.join(readings)}" if readings else ""
        written = f"{entry.text}, {entry.convention}".rstrip(", ")
        allowed = f"{said}{hint}; correct one, or set flux_from to the one to trust"
        raise InvalidValueError(f"datasheet.{entry.name}", written, allowed)

    def _other_readings(self, entry: Entry) -> list[tuple[str, float]]:
        """Conventions that the sheet does not name, and the flux that each would give [Wb]."""
        words = [word for word in _READINGS.get(entry.name, ()) if word != entry.convention]
        return [(word, self._flux_of(entry, word)) for word in words]

    def _agreeing(self, entry: Entry, reference: float) -> list[str]:
        """Other conventions of ``entry`` that give the reference flux."""
        readings = self._other_readings(entry)
        return [f"{entry.name} is '{word}'" for word, flux in readings if _agree(flux, reference)]

    def _factor(self, entry: Entry, convention: str) -> float:
        factor = current_factor if entry.name == "torque_constant" else voltage_factor
        return factor(convention, self._sheet.connection)

    def _flux_of(self, entry: Entry, convention: str) -> float:
        """The flux linkage if an entry of ``_FLUX_LAWS`` followed ``convention`` [Wb]."""
        law, _, _ = _FLUX_LAWS[entry.name]
        return law(self._motor_side(entry), self._factor(entry, convention), self._sheet.pole_pairs)

    def _flux_step(self, entry: Entry) -> float:
        """Write one way to the flux out."""
        _, formula, template = _FLUX_LAWS[entry.name]
        factor = self._factor(entry, entry.convention)
        numbers = template.format(v=self._motor_side(entry), c=factor, n=self._sheet.pole_pairs)
        said = f" ({entry.convention})" if entry.convention else ""
        flux = self._flux_of(entry, entry.convention)
        return self._step(f"psi from {entry.name}{said}", formula, numbers, flux, "Wb")

    def _peak(self, constant: float) -> tuple[float, float]:
        """Peak torque before saturation, and the saturation that the sheet implies."""
        current, torque = self._entries.get("peak_current"), self._entries.get("peak_torque")
        delivered = None if torque is None else self._motor_side(torque)
        quantity = "peak torque before saturation"
        if current is not None:
            amplitude = self._amplitude(current)
            numbers = f"{constant:.5g} x {amplitude:.5g}"
            before = self._step(quantity, "1.5 N psi i_peak", numbers, constant * amplitude, "N m")
            return before, self._saturation(before, delivered)
        if delivered is None:
            allowed = "give peak_current or peak_torque, the drive's limit"
            raise MissingValueError("datasheet.peak_current", allowed)
        alpha = self._stated_saturation() or 0.0
        before, numbers = delivered / (1.0 - alpha), f"{delivered:.5g} / (1 - {alpha:.3g})"
        return self._step(quantity, "tau / (1 - alpha)", numbers, before, "N m"), alpha

    def _amplitude(self, entry: Entry) -> float:
        factor = current_factor(entry.convention, self._sheet.connection)
        numbers, value = f"{factor:.4g} x {entry.value:.5g}", factor * entry.value
        return self._step(f"{entry.name} ({entry.convention})", "c i", numbers, value, "A (amplitude)")

    def _saturation(self, before: float, delivered: float | None) -> float:
        if delivered is None:
            return self._stated_saturation() or 0.0
        stated = None if self._sheet.saturation is None else self._stated_saturation()
        implied, numbers = 1.0 - delivered / before, f"1 - {delivered:.5g} / {before:.5g}"
        self._step("saturation from peak_torque", "1 - tau / (1.5 N psi i_peak)", numbers, implied, "")
        if implied < -_TOLERANCE or implied >= 0.5:
            self._peak_contradiction(delivered, before, implied)
        if stated is not None:
            if abs(stated - max(implied, 0.0)) > _TOLERANCE:
                said = f"implies a saturation of {implied:.3f}, the stated {stated:g} is used"
                self._notes.append(f"peak_torque {said}")
            return stated
        if implied < -_ROUNDING:
            said = f"lies {-implied:.1%} above 1.5 N psi i_peak: saturation taken as 0"
            self._notes.append(f"peak_torque {said}")
        return max(implied, 0.0)

    def _peak_contradiction(self, delivered: float, before: float, implied: float) -> None:
        entry, ratio = self._entries["peak_current"], self._sheet.gear_ratio
        hint = "check its convention; the current at the supply is another one"
        if ratio and _agree(delivered / before, ratio, _GEAR_TOLERANCE):
            hint = f"the two differ by the gear's ratio of {ratio:g}: write at = 'output' beside peak_torque"
        raise InvalidValueError(
            "datasheet.peak_torque",
            self._entries["peak_torque"].text,
            f"contradicts peak_current = '{entry.text}', {entry.convention}: the torque constant gives "
            f"{before:.4g} N m, so that the saturation would be {implied:.2f}; {hint}",
        )

    def _stated_saturation(self) -> float | None:
        value = self._sheet.saturation
        if value is None:
            note = "the sheet says nothing of saturation: taken as 0, measure it (motor identify)"
            self._notes.append(note)
            return None
        check_range("datasheet.saturation", value, 0.0, 0.499)
        return self._step("saturation as stated", "alpha", f"{value:g}", value, "")

    def _motor_side(self, entry: Entry) -> float:
        """An entry as it is before the gear: speeds are higher there, torques lower."""
        if not entry.at_output:
            return entry.value
        ratio = self._sheet.gear_ratio
        if ratio is None:
            allowed = "the sheet must give gear_ratio, a plain number"
            raise InvalidValueError(f"datasheet.{entry.name}", "at = 'output'", allowed)
        check_range("datasheet.gear_ratio", ratio, 1.0, 500.0)
        return entry.value * ratio if entry.name in ("no_load_speed", "kv") else entry.value / ratio

    def _i2t(self, motor: PmsmParameters) -> I2tLimit | None:
        """Continuous current, and how long the peak current may flow."""
        durations = [name for name in ("peak_duration", "winding_time_constant") if name in self._entries]
        rated = [name for name in ("rated_current", "rated_torque") if name in self._entries]
        if not durations or not rated:
            return None
        continuous = self._continuous_current(self._entries[rated[0]], motor)
        share = (continuous * motor.torque_constant / motor.peak_torque) ** 2
        if share >= 1.0:
            allowed = f"needs {continuous:.4g} A (amplitude), no less than the peak current"
            raise InvalidValueError(f"datasheet.{rated[0]}", self._entries[rated[0]].text, allowed)
        given = self._entries[durations[0]].value
        if durations[0] == "peak_duration":
            return I2tLimit(continuous_current=continuous, peak_duration=given)
        numbers, lasts = f"-{given:g} ln(1 - {share:.4g})", -given * math.log(1.0 - share)
        self._step("peak duration from cold", "-T ln(1 - (i_c / i_peak)^2)", numbers, lasts, "s")
        return I2tLimit(continuous_current=continuous, time_constant=given)

    def _continuous_current(self, rated: Entry, motor: PmsmParameters) -> float:
        """Amplitude of the rated current [A], or of the one that the rated torque needs."""
        if rated.name == "rated_current":
            return self._amplitude(rated)
        torque = self._motor_side(rated)
        current = float(desaturate(motor, torque)) / motor.torque_constant
        numbers = f"{torque:.5g} / {motor.torque_constant:.5g}"
        return self._step("continuous current from rated_torque", "tau / (1.5 N psi)", numbers, current, "A")

    def _heat(self) -> HousedHeat | None:
        """Both thermal nodes; a time constant is a node's heat capacity times its resistance outward."""
        known, found = self._entries, dict[str, float]()
        if not {"winding_thermal_resistance", "winding_time_constant", "housing_time_constant"} <= {*known}:
            return None
        for node, prefix in (("winding", ""), ("housing", "housing_")):
            if f"{node}_thermal_resistance" not in known:
                return None
            resistance = found[f"{prefix}thermal_resistance"] = known[f"{node}_thermal_resistance"].value
            time = known[f"{node}_time_constant"].value
            numbers, capacity = f"{time:g} / {resistance:g}", time / resistance
            found[f"{prefix}heat_capacity"] = self._step(
                f"heat capacity, {node}", "T / R_th", numbers, capacity, "J/K"
            )
        return HousedHeat(
            **found,
        )

    def _check_rated(self, constant: float) -> None:
        current, torque = self._entries.get("rated_current"), self._entries.get("rated_torque")
        if current is None or torque is None:
            return
        expected, given = constant * self._amplitude(current), self._motor_side(torque)
        if _agree(given, expected, _RATED_TOLERANCE):
            return
        ratio, cause = self._sheet.gear_ratio, "one of the two follows another convention"
        if ratio and _agree(given / expected, ratio, _GEAR_TOLERANCE):
            cause = f"that is the gear's ratio, {ratio:g}: write at = 'output'"
        self._notes.append(
            f"rated_torque is {given:.4g} N m, torque constant and rated_current give {expected:.4g} N m "
            f"({given / expected - 1.0:+.0%}): {cause}"
        )

    def _check_no_load(self, flux: float) -> None:
        if "no_load_speed" not in self._entries:
            return
        voltage = self._entries.get("no_load_voltage")
        if voltage is None:
            allowed = "no_load_speed needs the bus voltage it was taken at"
            raise InvalidValueError("datasheet.no_load_voltage", None, allowed)
        expected = voltage.value / (math.sqrt(3.0) * self._sheet.pole_pairs * flux)
        ratio = self._motor_side(self._entries["no_load_speed"]) / expected
        if not _NO_LOAD_RANGE[0] <= ratio <= _NO_LOAD_RANGE[1]:
            self._notes.append(
                f"no_load_speed is {ratio:.2f} times V / (sqrt(3) N psi) = {expected:.4g} rad/s: check the "
                "flux, the pole count and the voltage"
            )


def _agree(first: float, second: float, tolerance: float = _TOLERANCE) -> bool:
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
