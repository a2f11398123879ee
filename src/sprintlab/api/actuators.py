"""``actuators``: the library of actuators with published parameters, compared or one by one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from sprintlab.api.tables import Drawn, in_notebook, plain_table, styled
from sprintlab.core.arguments import checked

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sprintlab.motors import LibraryMotor


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Actuators(Drawn):
    """Actuators of the library; prints a comparison, or of one alone the source of every number."""

    chosen: tuple[LibraryMotor, ...]
    """Every actuator, or the one that was asked for."""
    compared: bool
    """Whether all were asked for."""

    def to_dict(self) -> dict[str, Any]:
        """Every number with its source, and what follows behind the gear, by the actuator's name."""
        return {actuator.name: _numbers(actuator) for actuator in self.chosen}

    def tables(self) -> Iterator[RenderableType]:
        """One row per actuator; of one alone, one row per number."""
        if not self.compared:
            yield _sources(self.chosen[0])
            return
        yield _comparison(self.chosen)
        yield (
            "joint side, speeds in rad/s, torques in N m; corner: up to there the peak torque fits; "
            "lost: what v_d takes from the corner; estimated: numbers without a published source"
        )

    def plot(self) -> Figure:
        """The envelopes of all actuators, absolute and normalised."""
        from sprintlab.evaluation.motor_figures import library_figure
        from sprintlab.motors import library_motors, load_library_motor

        return in_notebook(library_figure([load_library_motor(name) for name in library_motors()]))


@checked
def actuators(name: str | None = None) -> Actuators:
    """The actuators with published parameters, or one of them.

    Raises:
        InvalidValueError: no actuator has that name.
    """
    from sprintlab.motors import library_motors, load_library_motor

    names = library_motors() if name is None else (name,)
    return Actuators(chosen=tuple(map(load_library_motor, names)), compared=name is None)


def _numbers(actuator: LibraryMotor) -> dict[str, Any]:
    return {
        "name": actuator.name,
        "title": actuator.title,
        "values": {
            key: {
                "value": item.value,
                "unit": _unit(key),
                "source": item.source,
                "estimated": item.estimated,
            }
            for key, item in actuator.values.items()
        },
        "joint": joint_numbers(actuator),
    }


def _unit(key: str) -> str:
    """Unit of a value of the library, e.g. of ``motor.peak_torque``."""
    from sprintlab.motors.parameters import MOTOR_UNITS

    return {"bus_voltage": "V", **MOTOR_UNITS}.get(key.rpartition(".")[2], "")


def joint_numbers(actuator: LibraryMotor) -> dict[str, float]:
    """Peak torque after saturation [N m], no-load and corner speeds [rad/s] behind the gear."""
    from sprintlab.motors import critical_speed, joint_torque, no_load_speed, saturate

    motor, ratio, bus = actuator.motor, float(actuator.gear.ratio), actuator.bus_voltage
    refined, simplified = (
        float(critical_speed(motor, motor.peak_torque, bus, model)) / ratio
        for model in ("refined", "simplified-dc")
    )
    return {
        "peak_torque": float(joint_torque(actuator.gear, saturate(motor, motor.peak_torque))),
        "peak_current": float(motor.peak_torque / motor.torque_constant),
        "no_load_speed": float(no_load_speed(motor, bus)) / ratio,
        "corner_speed": refined,
        "corner_speed_v_d_0": simplified,
        "corner_lost_to_v_d": 1.0 - refined / simplified if simplified > 0.0 else 0.0,
        "reflected_inertia": float(motor.rotor_inertia) * ratio**2,
    }


def _comparison(chosen: tuple[LibraryMotor, ...]) -> RenderableType:
    columns = ("name", "bus", "gear", "peak torque", "peak current", "no load", "corner", "v_d = 0", "lost")
    table = plain_table("Actuators", *columns, "estimated", numbers=(*columns[1:], "estimated"))
    for actuator in chosen:
        joint = joint_numbers(actuator)
        keys = ("peak_torque", "peak_current", "no_load_speed", "corner_speed", "corner_speed_v_d_0")
        table.add_row(
            actuator.name,
            f"{actuator.bus_voltage:g} V",
            f"{actuator.gear.ratio:g}",
            *(f"{joint[key]:.1f}" for key in keys),
            f"{100 * joint['corner_lost_to_v_d']:.0f} %",
            str(len(actuator.estimated)),
        )
    return table


def _sources(actuator: LibraryMotor) -> RenderableType:
    table = plain_table(actuator.title, "quantity", "value", "unit", "", "source")
    table.columns[-1].overflow = "fold"
    for name, item in actuator.values.items():
        mark = styled("[yellow]estimated[/]") if item.estimated else ""
        table.add_row(name, f"{item.value:.5g}", _unit(name), mark, item.source)
    return table
