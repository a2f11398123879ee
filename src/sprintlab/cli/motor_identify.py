"""``sprintlab motor identify``: motor parameters from bench data, with intervals."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.api.identification import identify_motor
from sprintlab.cli.output import arguments, draw, show

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
    motor_speed: bool = False
    saturation_only: bool = False
    out: Path | None = None
    figure: Path | None = None
    json: bool = False

    def run(self) -> int:
        """Fit and print; raises ``SprintlabError`` for an unusable bench, or without SciPy."""
        options = arguments(self)
        out, rotor_inertia = options.pop("out"), options.pop("rotor_inertia")
        found = identify_motor(**options)
        draw(found, self.figure)
        if out is not None:
            found.save(out, rotor_inertia)
        show(found, self, motor_file=out)
        return 0 if found.trustworthy else UNTRUSTED
