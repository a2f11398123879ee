"""``identify_motor``: motor parameters from bench data, with intervals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from sprintlab.api.tables import Drawn, in_notebook, plain_table, written_for
from sprintlab.core.arguments import checked
from sprintlab.core.errors import InvalidValueError
from sprintlab.core.files import check_writable_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sprintlab.motors import PmsmParameters
    from sprintlab.workbench.identification import Identification


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class IdentifiedMotor(Drawn):
    """What a bench says of a motor: parameters with their intervals, and how well the model fits."""

    name: str
    """For tables and figures."""
    found: Identification
    """Estimates, residuals and warnings."""
    base: PmsmParameters | None = None
    """Supplies what the bench does not determine."""
    file: Path | None = None
    """Motor file that was written."""

    @property
    def trustworthy(self) -> bool:
        """Whether the model describes the data."""
        return self.found.trustworthy

    def save(self, path: Path | str, rotor_inertia: float | None = None) -> None:
        """Write a motor file; the rotor inertia [kg m^2] is the base motor's when left out.

        Raises:
            SprintlabError: a parameter is neither determined nor supplied, or the file cannot be written.
        """
        from sprintlab.motors import save_motor

        save_motor(self.found.motor(self.base, rotor_inertia), path)

    def to_dict(self) -> dict[str, Any]:
        """Estimates, fit quality and warnings."""
        from sprintlab.workbench.identification import OPTIONAL_UNITS, PARAMETER_UNITS

        result, units = self.found, PARAMETER_UNITS | OPTIONAL_UNITS
        return {
            "trustworthy": result.trustworthy,
            "pole_pairs": result.pole_pairs,
            "peak_current": result.peak_current,
            "torque_constant": result.torque_constant,
            "parameters": {
                name: {
                    "value": estimate.value,
                    "half_width_95": estimate.half_width,
                    "unit": units[name],
                    "determined": estimate.determined,
                    "reason": estimate.reason,
                }
                for name, estimate in result.estimates.items()
            },
            "channels": {
                fit.name: {
                    "noise": fit.noise,
                    "unit": fit.unit,
                    "explained": fit.explained,
                    "rows": len(fit.rows),
                }
                for fit in result.channels
            },
            "outlier_lines": result.outliers.tolist(),
            "singular_values": result.singular_values.tolist(),
            "warnings": list(result.warnings),
        }

    def tables(self) -> Iterator[RenderableType]:
        """Parameters, fit, outliers, warnings."""
        result, numbers = self.found, self.to_dict()
        yield _estimate_table(self.name, numbers)
        yield ""
        yield _channel_table(numbers["channels"])
        if len(result.outliers):
            lines = ", ".join(str(line) for line in result.outliers[:12].tolist())
            yield f"outliers in lines {lines}{' ...' if len(result.outliers) > 12 else ''}"
        for warning in result.warnings:
            yield f"warning: {warning}"
        if result.bench.unused:
            yield f"columns not read: {', '.join(result.bench.unused)}"
        if self.file is not None:
            yield f"motor file: {self.file}"

    def plot(self) -> Figure:
        """Fit against data, and residuals over current and speed."""
        from sprintlab.evaluation.motor_figures import identification_figure

        return in_notebook(identification_figure(self.found, self.name))


@checked
def identify_motor(
    bench: Path | str,
    *,
    pole_pairs: int | None = None,
    peak_current: float | None = None,
    base: Path | str | None = None,
    hold: Sequence[str] = (),
    also: Sequence[str] = (),
    window: float = 0.1,
    rotor_inertia: float | None = None,
    column: Sequence[str] = (),
    gear_ratio: float = 1.0,
    motor_speed: bool = False,
    saturation_only: bool = False,
    output: Path | str | None = None,
) -> IdentifiedMotor:
    """Fit resistance, inductance, flux, saturation, friction and usable voltage to bench data.

    The bench is a CSV of steady points with units in its header: speed [rad/s], iq [A] (or phase_current
    [A rms]) and torque [N m]; better also vq [V], vd [V], power [W], bus_voltage [V], temperature [degC] and
    limited (1 where the inverter gives all its voltage). The status is 1 when the model does not describe the
    data.

    Args:
        bench: the measurements (CSV).
        pole_pairs: pole pairs of the motor; the base motor's when left out.
        peak_current: amplitude of the drive's current limit [A], to which saturation and peak torque refer;
            the base motor's when left out.
        base: motor file, robot or actuator that supplies what the bench does not determine.
        hold: parameters not fitted but taken from the base motor (friction and flux_drift: 0,
            voltage_utilization: 0.95).
        also: parameters fitted only on request: torque_offset and current_offset (what the sensors read at
            zero), gear_efficiency (a gear that loses a share of the load), rotor_inertia (of a log).
        window: for a log with a time column, e.g. 100 rows a second: means over windows of this length [s] in
            which current and speed rest.
        rotor_inertia: [kg m^2] for the motor file; the base motor's when left out.
        column: name=heading or name=heading:unit, for a column that the file calls otherwise.
        gear_ratio: ratio of a gear between the motor and the torque sensor; results are the motor's.
        motor_speed: behind a gear, the speed is the motor's already.
        saturation_only: the file is a torque-current table at one speed; fit flux and saturation alone.
        output: motor file to write; none when left out.

    Raises:
        SprintlabError: the bench cannot be used, or a choice is refused.
        UnwrittenError: the disk has no room for the file any more; its ``found`` is the motor.
    """
    if output is not None:
        check_writable_file(output)
    from sprintlab.workbench.identification import behind_gear, identify, is_log, load_bench, rested

    known = None if base is None else _base_motor(str(base))
    if pole_pairs is None:
        if known is None:
            allowed = "give --pole-pairs or --base: it is counted, not fitted"
            raise InvalidValueError("pole_pairs", None, allowed)
        pole_pairs = int(known.pole_pairs)
    if peak_current is None and known is not None:
        peak_current = float(known.peak_torque / known.torque_constant)
    data = load_bench(bench, needs_speed=not saturation_only, columns=column)
    if is_log(data, window):
        data = rested(data, window, "rotor_inertia" in also)
    data = behind_gear(data, gear_ratio, motor_speed)
    if saturation_only:
        data = replace(data, speed=None, q_voltage=None, d_voltage=None, power=None)
    found = identify(data, pole_pairs=pole_pairs, peak_current=peak_current, base=known, hold=hold, also=also)
    motor = IdentifiedMotor(name=Path(bench).stem, found=found, base=known)
    if output is None:
        return motor
    with written_for(motor):
        motor.save(output, rotor_inertia)
    return replace(motor, file=Path(output))


def _base_motor(source: str) -> PmsmParameters:
    from sprintlab.api.motors import chosen_motor, file_motor

    return file_motor(source)[0] if source.endswith(".toml") else chosen_motor(source, "").drive.motor


def _estimate_table(title: str, numbers: dict[str, Any]) -> Any:
    columns = ("value", "95 % interval")
    table = plain_table(title, "parameter", *columns, "unit", "", numbers=columns)
    for name, found in numbers["parameters"].items():
        value, width = found["value"], found["half_width_95"]
        unknown = value is None or not found["determined"]
        shown = "-" if value is None else f"{value:.5g}"
        interval = "-" if width is None else f"± {width:.2g}"
        remark = f"not determined: {found['reason']}" if unknown else found["reason"]
        table.add_row(name, shown, interval, found["unit"], remark, style="dim" if unknown else None)
    return table


def _channel_table(channels: dict[str, Any]) -> Any:
    columns = ("rows", "noise (1 sigma)", "explained")
    table = plain_table("Fit", "quantity", *columns, "unit", numbers=columns)
    for name, fit in channels.items():
        table.add_row(name, str(fit["rows"]), f"{fit['noise']:.3g}", f"{fit['explained']:.2%}", fit["unit"])
    return table
