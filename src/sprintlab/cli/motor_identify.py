"""``sprintlab motor identify``: motor parameters from bench data, with intervals."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from sprintlab.cli.output import plain_table, print_json, show_files, stdout_console
from sprintlab.core.extras import require_package
from sprintlab.core.files import check_figure_path

if TYPE_CHECKING:
    from sprintlab.workbench.identification import Identification

UNTRUSTED = 1


@dataclass(frozen=True, kw_only=True)
class MotorIdentify:
    """Fit resistance, inductance, flux, saturation, friction and usable voltage to bench data.

    The bench is a CSV of steady points with units in its header: speed [rad/s], iq [A] (or phase_current
    [A rms]) and torque [N m]; better also vq [V], vd [V], power [W], bus_voltage [V], temperature [degC] and
    limited (1 where the inverter gives all its voltage). The status is 1 when the model does not describe the
    data.

    Attributes:
        bench: the measurements (CSV).
        pole_pairs: of the motor; the base motor's when left out.
        peak_current: amplitude of the drive's current limit [A], to which saturation and peak torque refer.
        base: motor file that supplies what the bench does not determine.
        hold: parameters not fitted but taken from the base motor (friction and flux_drift: 0,
            voltage_utilization: 0.95).
        also: parameters fitted only on request: torque_offset and current_offset (what the sensors read at
            zero), gear_efficiency (a gear that loses a share of the load), rotor_inertia (of a log).
        window: of a log with a time column, e.g. 100 rows a second: means over windows of this length [s] in
            which current and speed rest.
        rotor_inertia: [kg m^2] for the motor file; the base motor's when left out.
        column: name=heading or name=heading:unit, for a column that the file calls otherwise.
        gear_ratio: of a gear between the motor and the torque sensor; results are the motor's.
        motor_speed: behind a gear, the speed is the motor's already.
        saturation_only: the file is a torque-current table at one speed; fit flux and saturation alone.
        out: motor file to write; none when left out.
        figure: picture (.png, .pdf or .svg) of fit and residuals; none when left out.
        json: print JSON only.
    """

    bench: tyro.conf.Positional[Path]
    pole_pairs: int | None = None
    peak_current: float | None = None
    base: Path | None = None
    hold: tuple[str, ...] = ()
    also: tuple[str, ...] = ()
    window: float = 0.1
    rotor_inertia: float | None = None
    column: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    gear_ratio: float = 1.0
    motor_speed: tyro.conf.FlagCreatePairsOff[bool] = False
    saturation_only: tyro.conf.FlagCreatePairsOff[bool] = False
    out: Path | None = None
    figure: Path | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Fit and print; raises ``SprintlabError`` for an unusable bench, or without SciPy."""
        check_figure_path(self.figure)
        require_package("scipy", extra="analysis", use="sprintlab motor identify")
        base = self._base_motor()
        result = self._identify(base)
        if self.figure is not None:
            _draw(self.figure, result, self.bench.stem)
        if self.out is not None:
            from sprintlab.motors import save_motor

            save_motor(result.motor(base, self.rotor_inertia), self.out)
        numbers = identification_numbers(result)
        if self.json:
            print_json(numbers)
        else:
            self._print(result, numbers)
        return 0 if result.trustworthy else UNTRUSTED

    def _base_motor(self) -> Any:
        if self.base is None:
            return None
        from sprintlab.api.motors import chosen_motor

        return chosen_motor(str(self.base), "", None).drive.motor

    def _identify(self, base: Any) -> Identification:
        from dataclasses import replace

        from sprintlab.core.errors import InvalidValueError
        from sprintlab.workbench.identification import behind_gear, identify, is_log, load_bench, rested

        pole_pairs = self.pole_pairs
        if pole_pairs is None and base is not None:
            pole_pairs = int(base.pole_pairs)
        if pole_pairs is None:
            raise InvalidValueError(
                "pole_pairs", None, "give --pole-pairs or --base: it is counted, not fitted"
            )
        peak_current = self.peak_current
        if peak_current is None and base is not None:
            peak_current = float(base.peak_torque / base.torque_constant)
        bench = load_bench(self.bench, needs_speed=not self.saturation_only, columns=self.column)
        if is_log(bench, self.window):
            bench = rested(bench, self.window, "rotor_inertia" in self.also)
        bench = behind_gear(bench, self.gear_ratio, self.motor_speed)
        if self.saturation_only:
            bench = replace(bench, speed=None, q_voltage=None, d_voltage=None, power=None)
        return identify(
            bench,
            pole_pairs=pole_pairs,
            peak_current=peak_current,
            base=base,
            hold=self.hold,
            also=self.also,
        )

    def _print(self, result: Identification, numbers: dict[str, Any]) -> None:
        console = stdout_console()
        console.print(_estimate_table(self.bench.stem, numbers))
        console.print()
        console.print(_channel_table(numbers["channels"]))
        if len(result.outliers):
            lines = ", ".join(str(line) for line in result.outliers[:12].tolist())
            console.print(f"outliers in lines {lines}{' ...' if len(result.outliers) > 12 else ''}")
        for warning in result.warnings:
            console.print(f"warning: {warning}")
        if result.bench.unused:
            console.print(f"columns not read: {', '.join(result.bench.unused)}")
        show_files(motor_file=self.out, figure=self.figure)


def identification_numbers(result: Identification) -> dict[str, Any]:
    """Estimates, fit quality and warnings, ready for JSON."""
    from sprintlab.workbench.identification import OPTIONAL_UNITS, PARAMETER_UNITS

    units = PARAMETER_UNITS | OPTIONAL_UNITS
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


def _draw(path: Path, result: Identification, title: str) -> None:
    from sprintlab.core.theme import save_figure
    from sprintlab.evaluation.identification_figures import identification_figure

    save_figure(path, identification_figure(result, title))
