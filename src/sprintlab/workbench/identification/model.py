"""What a bench should show for given parameters: one residual channel a measured quantity.

With ``w = N omega``, one inductance for both axes and the peak current ``I``::

    tau = 1.5 N psi i_q (1 - alpha |i_q| / I) eta^s - coulomb sign(omega) - viscous omega - J domega/dt
    v_q = R i_q + w (L i_d + psi)
    v_d = R i_d - w L i_q
    P = 1.5 (v_q i_q + v_d i_d)          where the power was measured
    |v| = gamma V_bus / sqrt(3)          where the inverter gives all its voltage

``s`` is 1 where the motor drives and -1 where it brakes; the gear's efficiency ``eta`` is 1 unless it is
fitted, and the zeros of the two sensors and the rotor's inertia ``J`` are 0 unless they are. At standstill
friction may point either way: where other rows turn, the rows that stand tell nothing about the torque.

Where the bench has a temperature, ``R`` and ``psi`` are those at 20 degC: copper gains 0.393 % per kelvin,
and the flux ``psi (1 + k (T - 20))`` changes by a coefficient that is fitted where the temperatures differ.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.array_types import FloatArray
from sprintlab.motors.thermal import COPPER_COEFFICIENT
from sprintlab.motors.voltage import VOLTAGE_UTILIZATION
from sprintlab.workbench.identification.bench import Bench

Parameters = Mapping[str, float]

REFERENCE_TEMPERATURE = 20.0
"""Temperature to which the resistance is referred [degC]."""

LEAST_WARMING = 10.0
"""Range of temperatures below which the flux shows no drift [K]."""


class Sizes(NamedTuple):
    """How large the quantities of a bench are: what its parameters are measured by."""

    pole_pairs: int
    current: float  # largest [A]
    torque: float  # largest [N m]
    speed: float  # largest [rad/s]
    voltage: float  # largest [V]
    acceleration: float  # largest [rad/s^2]
    warming: float  # range of the temperatures, at least 1 [K]
    flux: float  # by torque over current [Wb]
    resistance: float  # by voltage over current [ohm]; 0 where that is not known


class Parameter(NamedTuple):
    """What the fit knows of one parameter."""

    unit: str
    low: float  # where the fit may look
    high: float
    guess: Callable[[Sizes], float]  # where it begins; also the unit in which it moves
    effect: Callable[[Sizes], float] = lambda sizes: 0.0  # that moves a channel by its whole range
    share: float = 0.5  # half width over value beyond which it is not determined
    absence: str = "needs speeds of a shaft that turns"  # why it may be unknown
    neutral: float | None = None  # value of one that is fitted only on request, where it is not


PARAMETERS = {
    "stator_resistance": Parameter(
        "ohm", 0.0, 100.0, lambda x: x.resistance if x.resistance > 0 else 0.1 * x.voltage / x.current,
        lambda x: x.voltage / x.current,
        absence="needs vq or power, or rows marked limited with a bus_voltage",
    ),
    "q_axis_inductance": Parameter(
        "H", 0.0, 0.1, lambda x: 0.2 * x.voltage / (x.pole_pairs * x.speed * x.current),
        lambda x: x.voltage / (x.pole_pairs * x.speed * x.current),
        absence="needs vd, or rows marked limited with a bus_voltage",
    ),
    "flux_linkage": Parameter("Wb", 1e-6, 2.0, lambda x: x.flux, share=0.1),
    "flux_drift": Parameter(  # ferrites, the worst of magnets, lose 0.2 % per kelvin
        "1/K", -0.003, 0.001, lambda x: 1e-3, lambda x: 1.0 / x.warming,
        absence=f"needs temperatures that differ by {LEAST_WARMING:g} K",
    ),
    "saturation": Parameter("", 0.0, 0.499, lambda x: 0.1, lambda x: 2.0),
    "coulomb_friction": Parameter("N m", 0.0, 1e3, lambda x: 0.02 * x.torque, lambda x: x.torque),
    "viscous_friction": Parameter(
        "N m s/rad", 0.0, 1e2, lambda x: 0.02 * x.torque / x.speed, lambda x: x.torque / x.speed
    ),
    "voltage_utilization": Parameter(
        "", 0.05, 1.3, lambda x: VOLTAGE_UTILIZATION, share=0.1,
        absence="needs a bus_voltage and rows marked limited",
    ),
    "torque_offset": Parameter(
        "N m", -1e3, 1e3, lambda x: 0.01 * x.torque, lambda x: x.torque, neutral=0.0
    ),
    "current_offset": Parameter(
        "A", -1e3, 1e3, lambda x: 0.01 * x.current, lambda x: x.current, neutral=0.0
    ),
    "gear_efficiency": Parameter("", 0.3, 1.0, lambda x: 0.9, share=0.1, neutral=1.0),
    "rotor_inertia": Parameter(
        "kg m^2", 0.0, 10.0, lambda x: 0.02 * x.torque / x.acceleration,
        lambda x: x.torque / x.acceleration, neutral=0.0,
    ),
}  # fmt: skip
"""What a bench can tell; names as in ``PmsmParameters`` where it has them. Only on request: readings of the
sensors at zero, a gear's loss with the load, and, of a log, the inertia between current and torque sensor."""

PARAMETER_UNITS = {name: each.unit for name, each in PARAMETERS.items() if each.neutral is None}
OPTIONAL_UNITS = {name: each.unit for name, each in PARAMETERS.items() if each.neutral is not None}
NEUTRAL = {name: each.neutral or 0.0 for name, each in PARAMETERS.items()}
"""Values of parameters that are not fitted."""

STANDING = 0.5
"""Speed up to which the shaft counts as standing [rad/s]: its sign is the encoder's noise."""

LEAST_TURNING = 0.1
"""Share of rows that must turn to be those that count: a stalled motor swings when it is let go."""

_STANDING_SHARE = 0.01  # share of the largest speed, likewise


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One measured quantity."""

    name: str  # ``torque``, ``vq``, ``vd``, ``power`` or ``voltage limit``
    unit: str  # unit of its residuals
    measured: FloatArray  # (m,) values that the residuals are subtracted from
    predict: Callable[[Parameters], FloatArray]  # model values (m,) for parameters
    rows: NDArray[np.int64]  # (m,) rows of the bench
    depends_on: tuple[str, ...]  # parameters that the prediction looks at


def shaft_torque(values: Parameters, pole_pairs: int, peak_current: float, bench: Bench) -> FloatArray:
    """Torque on the shaft [N m] ``(n,)``, saturation and friction in; no friction without speeds."""
    current = bench.current - values["current_offset"]
    direction, speed = directions(bench), np.zeros(bench.size) if bench.speed is None else bench.speed
    ideal = 1.5 * pole_pairs * linked_flux(values, bench) * current
    saturated = ideal * (1.0 - values["saturation"] * np.abs(current) / peak_current)
    passed_on = saturated * values["gear_efficiency"] ** (np.sign(current) * direction)
    lost = values["coulomb_friction"] * direction + values["viscous_friction"] * speed
    if bench.acceleration is not None:  # what turns the rotor does not reach the sensor
        lost = lost + values["rotor_inertia"] * bench.acceleration
    return passed_on - lost + values["torque_offset"]


def directions(bench: Bench) -> FloatArray:
    """Direction in which each row turns, -1, 0 or 1 ``(n,)``; 0 where the shaft stands."""
    if bench.speed is None:
        return np.zeros(bench.size)
    least = max(STANDING, _STANDING_SHARE * float(np.max(np.abs(bench.speed))))
    return np.where(np.abs(bench.speed) > least, np.sign(bench.speed), 0.0)


def turns(bench: Bench) -> bool:
    """Whether enough rows turn to tell friction; else the bench is one of a stalled motor."""
    return float(np.mean(directions(bench) != 0.0)) >= LEAST_TURNING


def torque_rows(bench: Bench) -> NDArray[np.int64]:
    """Rows whose torque counts: those that turn; of a bench that hardly ever turns, those that stand."""
    return np.flatnonzero((directions(bench) != 0.0) == turns(bench))


def phase_voltages(values: Parameters, pole_pairs: int, bench: Bench) -> tuple[FloatArray, FloatArray]:
    """``(v_q, v_d)`` [V] ``(n,)`` each."""
    assert bench.speed is not None
    electrical = pole_pairs * bench.speed
    resistance = values["stator_resistance"] * resistance_factor(bench)
    inductance = values["q_axis_inductance"]
    current = bench.current - values["current_offset"]
    v_q = resistance * current + electrical * (inductance * bench.d_current + linked_flux(values, bench))
    v_d = resistance * bench.d_current - electrical * inductance * current
    return v_q, v_d


def resistance_factor(bench: Bench) -> FloatArray:
    """Resistance over its value at 20 degC ``(n,)``; 1 where no temperature was measured."""
    if bench.temperature is None:
        return np.ones(bench.size)
    return 1.0 + COPPER_COEFFICIENT * (bench.temperature - REFERENCE_TEMPERATURE)


def linked_flux(values: Parameters, bench: Bench) -> FloatArray:
    """Flux linkage at the temperature of each row [Wb] ``(n,)``."""
    if bench.temperature is None:
        return np.full(bench.size, values["flux_linkage"])
    rise = bench.temperature - REFERENCE_TEMPERATURE
    return values["flux_linkage"] * (1.0 + values["flux_drift"] * rise)


def warming(bench: Bench) -> float:
    """Range of the temperatures [K]; 0 where none was measured."""
    return 0.0 if bench.temperature is None else float(np.ptp(bench.temperature))


def channels(
    bench: Bench, pole_pairs: int, peak_current: float, also: Sequence[str] = ()
) -> tuple[Channel, ...]:
    """Every channel that the bench's columns allow, the torque first; ``also``: optional parameters.

    With i_d = 0 each voltage sees a part of the parameters: v_q the resistance, v_d the inductance.
    """
    drifts = warming(bench) >= LEAST_WARMING
    flux = ("flux_linkage", "flux_drift") if drifts else ("flux_linkage",)
    friction = ("coulomb_friction", "viscous_friction") if turns(bench) else ()
    rows, everything = torque_rows(bench), np.arange(bench.size)
    torque = Channel(
        name="torque",
        unit="N m",
        measured=bench.torque[rows],
        predict=lambda values: shaft_torque(values, pole_pairs, peak_current, bench)[rows],
        rows=rows,
        depends_on=("saturation", *flux, *friction, *also),
    )
    if bench.speed is None:
        return (torque,)

    def power(values: Parameters) -> FloatArray:
        v_q, v_d = phase_voltages(values, pole_pairs, bench)
        return 1.5 * (v_q * (bench.current - values["current_offset"]) + v_d * bench.d_current)

    weakened = bool(bench.d_current.any())
    both = ("stator_resistance", "q_axis_inductance")
    from_q, from_d = (both, both) if weakened else (both[:1], both[1:])
    measured = (
        ("vq", "V", bench.q_voltage, lambda values: phase_voltages(values, pole_pairs, bench)[0], from_q),
        ("vd", "V", bench.d_voltage, lambda values: phase_voltages(values, pole_pairs, bench)[1], from_d),
        ("power", "W", bench.power, power, both[:1]),
    )
    found = [
        Channel(
            name=name,
            unit=unit,
            measured=column,
            predict=predict,
            rows=everything,
            depends_on=electrical if name == "vd" else (*electrical, *flux),
        )
        for name, unit, column, predict, electrical in measured
        if column is not None
    ]
    return (torque, *found, *_limit_channel(bench, pole_pairs, (*both, *flux)))


def _limit_channel(bench: Bench, pole_pairs: int, electrical: tuple[str, ...]) -> tuple[Channel, ...]:
    """The bus's share that the voltage reaches; from measured voltages if there are any."""
    rows = np.flatnonzero(bench.limited)
    if bench.bus_voltage is None or len(rows) == 0:
        return ()
    limit, measured = bench.bus_voltage[rows] / math.sqrt(3.0), np.zeros(len(rows))
    if bench.q_voltage is not None and bench.d_voltage is not None:
        measured, electrical = np.hypot(bench.q_voltage, bench.d_voltage)[rows], ()

    def reached(values: Parameters) -> FloatArray:
        allowed = values["voltage_utilization"] * limit
        if not electrical:
            return allowed
        return np.hypot(*phase_voltages(values, pole_pairs, bench))[rows] - allowed

    depends_on = (*electrical, "voltage_utilization")
    name = "voltage limit"
    return (
        Channel(name=name, unit="V", measured=measured, predict=reached, rows=rows, depends_on=depends_on),
    )
