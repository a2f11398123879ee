"""Battery and winding heat of all environments: the law of ``motors.battery`` and ``motors.thermal`` in Warp.

One thread an environment finds the voltage at which its motors draw just the power that lowers the bus
to it, before ``joint_torque_kernel`` runs; a test proves it equal to ``motors.shared_bus_voltage``. Without a
battery nothing is launched, and without heat the torque kernel touches no temperature.
"""

from __future__ import annotations

# Warp rewrites kernels from their source; their types are Warp's, not Python's.
# pyright: reportArgumentType=false, reportCallIssue=false, reportGeneralTypeIssues=false
# pyright: reportInvalidTypeForm=false, reportOperatorIssue=false
from typing import Any

import numpy as np
import torch
import warp as wp

from sprintlab.motors import Battery, WindingHeat, phase_voltage_limit
from sprintlab.training.environment.actuation import (
    JointDrive,
    JointHeat,
    copper_loss,
    motor_interval,
    motor_now,
    shaft_torque,
    wanted_torque,
)
from sprintlab.training.settings import SimulationSettings

# No gradients, and loops stay loops: unrolled, dozens of steps of all joints would take minutes to compile.
wp.set_module_options({"enable_backward": False, "max_unroll": 1})

_SOLVER_STEPS = 34  # as in motors.battery; an environment stops as soon as its residual is small
_SOLVER_TOLERANCE = 1e-4  # [V]
_FIRST_ROOM = _SOLVER_TOLERANCE * 2.0**_SOLVER_STEPS
_PHASE_SHARE = float(phase_voltage_limit(1.0))
_SECONDS_PER_HOUR = 3600.0


@wp.struct
class Pack:
    """One battery's constants (SI)."""

    series_cells: float
    resistance: float
    capacity: float  # [A s]
    regeneration_limit: float
    table_size: int


@wp.func
def source_voltage(
    pack: Pack, charge_table: wp.array(dtype=float), voltage_table: wp.array(dtype=float), charge: float
):
    """Open-circuit voltage, linear between the table's points."""
    voltage = voltage_table[0]
    for index in range(pack.table_size - 1):
        width = charge_table[index + 1] - charge_table[index]
        share = wp.clamp((charge - charge_table[index]) / width, 0.0, 1.0)
        voltage += share * (voltage_table[index + 1] - voltage_table[index])
    return pack.series_cells * voltage


@wp.func
def loaded_voltage(pack: Pack, source: float, power: float):
    """Voltage of the bus while the joints draw a power."""
    squared = source * source - 4.0 * pack.resistance * power
    voltage = 0.5 * (source + wp.sqrt(wp.max(squared, 0.0)))
    return wp.min(voltage, source + pack.resistance * pack.regeneration_limit)


@wp.func
def drawn_power(
    environment: int,
    drives: wp.array(dtype=JointDrive),
    heats: wp.array(dtype=JointHeat),
    target: wp.array2d(dtype=float),
    stiffness: wp.array2d(dtype=float),
    damping: wp.array2d(dtype=float),
    resistance_factor: wp.array(dtype=float),
    qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float),
    winding_temperature: wp.array2d(dtype=float),
    model: int,
    heated: int,
    voltage: float,
):
    """Power that all joints of an environment draw at a phase voltage limit [W]."""
    power = float(0.0)
    for joint in range(drives.shape[0]):
        drive = drives[joint]
        temperature = float(0.0)
        if heated == 1:
            temperature = winding_temperature[environment, joint]
        velocity = qvel[environment, drive.qvel_index]
        speed = drive.ratio * velocity
        motor = motor_now(drive, heats[joint], heated, temperature, resistance_factor[environment], speed)
        desired = motor.flux_factor * wanted_torque(
            drive,
            stiffness[environment, joint],
            damping[environment, joint],
            target[environment, joint],
            qpos[environment, drive.qpos_index],
            velocity,
        )
        interval = motor_interval(motor, voltage, model)
        torque = wp.min(wp.max(desired, interval[0]), interval[1])
        power += shaft_torque(drive, motor, torque) * speed + copper_loss(motor, torque, voltage, model)
    return power


@wp.kernel
def bus_voltage_kernel(
    drives: wp.array(dtype=JointDrive),
    heats: wp.array(dtype=JointHeat),
    target: wp.array2d(dtype=float),
    previous_target: wp.array2d(dtype=float),
    delay: wp.array(dtype=int),
    stiffness: wp.array2d(dtype=float),
    damping: wp.array2d(dtype=float),
    resistance_factor: wp.array(dtype=float),
    qpos: wp.array2d(dtype=float),
    qvel: wp.array2d(dtype=float),
    winding_temperature: wp.array2d(dtype=float),
    pack: Pack,
    charge_table: wp.array(dtype=float),
    voltage_table: wp.array(dtype=float),
    timestep: float,
    model: int,
    heated: int,
    substep: int,
    state_of_charge: wp.array(dtype=float),
    voltage: wp.array(dtype=float),
):
    """Phase voltage limit of each environment [V], and the charge that its current leaves."""
    environment = wp.tid()
    asked = target
    if substep < delay[environment]:
        asked = previous_target
    source = source_voltage(pack, charge_table, voltage_table, state_of_charge[environment])
    low = 0.5 * source
    high = source + pack.resistance * pack.regeneration_limit
    bus = high
    older = high
    older_error = float(0.0)
    error = float(1.0e6)
    power = float(0.0)
    room = float(_FIRST_ROOM)
    for step in range(_SOLVER_STEPS):
        if wp.abs(error) > _SOLVER_TOLERANCE:
            if step > 0:
                slope = float(1.0)
                if wp.abs(bus - older) > 1.0e-6 * bus:
                    slope = wp.max((error - older_error) / (bus - older), 0.1)
                older = bus
                older_error = error
                middle = 0.5 * (low + high)
                room *= 0.5
                reach = wp.max(room - 0.5 * (high - low), 0.0)
                bus = wp.clamp(bus - error / slope, middle - reach, middle + reach)
                if bus <= low or bus >= high:
                    bus = middle
            power = drawn_power(
                environment,
                drives,
                heats,
                asked,
                stiffness,
                damping,
                resistance_factor,
                qpos,
                qvel,
                winding_temperature,
                model,
                heated,
                _PHASE_SHARE * bus,
            )
            error = bus - loaded_voltage(pack, source, power)
            high = wp.where(error > 0.0, bus, high)
            low = wp.where(error > 0.0, low, bus)
    current = wp.max(power / bus, -pack.regeneration_limit)
    left = state_of_charge[environment] - current * timestep / pack.capacity
    state_of_charge[environment] = wp.clamp(left, 0.0, 1.0)
    voltage[environment] = _PHASE_SHARE * bus


class Supply:
    """Charge and winding temperatures of all environments, and what they start from.

    Attributes (torch, ``n`` environments; one row of each where battery or heat is off):
        state_of_charge: ``(n,)``.
        winding_temperature: ``(n, joints)`` [degC].
    """

    def __init__(self, settings: SimulationSettings, joints: int, device: str) -> None:
        self._settings = settings
        n = settings.environments
        self.heated = int(settings.heat is not None)
        self._start_charge = torch.ones(1, device=device)
        self._start_temperature = torch.zeros(1, joints, device=device)
        if settings.battery is not None:
            self._start_charge = _drawn(settings.state_of_charge, (n,), device)
        if settings.heat is not None:
            self._start_temperature = _drawn(settings.winding_temperature, (n, joints), device)
        self.state_of_charge = self._start_charge.clone()
        self.winding_temperature = self._start_temperature.clone()
        self.heats = wp.array(joint_heats(settings, joints), dtype=JointHeat, device=wp.get_device(device))
        self._launch: dict[str, Any] | None = None

    def connect(self, inputs: list[Any], state: list[Any], model: int, voltage: Any) -> None:
        """Prepare the launch that finds the bus voltage; nothing to do without a battery.

        Args:
            inputs: drives, target, previous target, delay, stiffness, damping, resistance factor (Warp).
            state: the simulator's positions and velocities.
            model: code of the motor model.
            voltage: phase voltage limit ``(n,)``, written by every launch.
        """
        battery = self._settings.battery
        if battery is None:
            return
        device = voltage.device
        tables = (battery.charge_table, battery.voltage_table)
        drives, *others = inputs
        self._launch = {
            "kernel": bus_voltage_kernel,
            "dim": self._settings.environments,
            "inputs": [
                drives,
                self.heats,
                *others,
                *state,
                wp.from_torch(self.winding_temperature, dtype=wp.float32),
                battery_pack(battery),
                *(wp.array(table, dtype=float, device=device) for table in tables),
                self._settings.timestep,
                model,
                self.heated,
            ],
            "outputs": [wp.from_torch(self.state_of_charge, dtype=wp.float32), voltage],
            "device": device,
        }

    def launch(self, substep: int) -> None:
        """Find every bus voltage of this substep."""
        if self._launch is not None:
            wp.launch(**{**self._launch, "inputs": [*self._launch["inputs"], substep]})

    def restart(self, reset_mask: torch.Tensor, copied: torch.Tensor, donors: torch.Tensor) -> None:
        """Give ``reset_mask`` their first charge and temperatures, ``copied`` ones their donor's.

        Args:
            reset_mask: bool ``(n,)``.
            copied: bool ``(n,)``, apart from ``reset_mask``.
            donors: index ``(n,)`` of the environment that each may copy.
        """
        if self._settings.battery is not None:
            _renew(self.state_of_charge, self._start_charge, reset_mask, copied, donors)
        if self.heated:
            reset_mask, copied = reset_mask[:, None], copied[:, None]
            _renew(self.winding_temperature, self._start_temperature, reset_mask, copied, donors)


def battery_pack(battery: Battery) -> Pack:
    """A battery's constants for the kernel."""
    pack = Pack()
    pack.series_cells = float(battery.series_cells)
    pack.resistance = battery.internal_resistance
    pack.capacity = battery.capacity * _SECONDS_PER_HOUR
    pack.regeneration_limit = battery.regeneration_limit
    pack.table_size = len(battery.charge_table)
    return pack


def joint_heats(settings: SimulationSettings, joints: int) -> np.ndarray:
    """One ``JointHeat`` a joint, as Warp's structured array."""
    heat = settings.heat or WindingHeat()
    heats = np.zeros(joints, dtype=JointHeat.numpy_dtype())
    heats["thermal_resistance"] = heat.thermal_resistance
    heats["decay"] = np.exp(-settings.timestep / (heat.thermal_resistance * heat.heat_capacity))
    heats["ambient"] = heat.ambient_temperature
    heats["reference"] = heat.reference_temperature
    heats["flux_coefficient"] = heat.flux_coefficient
    heats["magnet_share"] = heat.magnet_share
    return heats


def _drawn(interval: tuple[float, float], shape: tuple[int, ...], device: str) -> torch.Tensor:
    """Uniform in the interval."""
    low, high = interval
    return low + (high - low) * torch.rand(*shape, device=device)


def _renew(
    state: torch.Tensor,
    first: torch.Tensor,
    reset_mask: torch.Tensor,
    copied: torch.Tensor,
    donors: torch.Tensor,
) -> None:
    state.copy_(torch.where(reset_mask, first, torch.where(copied, state[donors], state)))
