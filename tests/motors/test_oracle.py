"""Envelope points against a time-domain simulation that is not ours: motulator of Aalto University.

Its synchronous machine is integrated in time behind its inverter, with its current controller holding a
reference at a constant shaft speed; torque and voltage are read off once it has settled. The envelope's point
is where the voltage crosses what the inverter may use. The simulated bus is higher than that, so that
currents on both sides of the point can be held.
"""

import math

import matplotlib
import numpy as np
import pytest

from sprintlab.motors import (
    PmsmParameters,
    dq_currents,
    no_load_speed,
    phase_voltage_limit,
    torque_limits,
)

pytest.importorskip("motulator")

with matplotlib.rc_context():  # its import changes the style of every figure
    import motulator.drive.control.sm as control
    from motulator.drive import model
    from motulator.drive.utils import SynchronousMachinePars

MOTORS = 8
SETTLING = 60  # samples until a reference is reached: twelve time constants of the current loop
READING = 5  # samples that are averaged after that


class HeldCurrents:
    """Current references, one after the other, in place of motulator's torque reference."""

    def __init__(self, currents, duration):
        self._currents, self._duration = currents, duration

    def output(self, _feedback, reference):
        index = min(int(reference.t / self._duration + 1e-9), len(self._currents) - 1)
        reference.i_s = self._currents[index]
        return reference

    def update(self, feedback, reference):
        pass


def machine_parameters(motor):
    return SynchronousMachinePars(
        n_p=motor.pole_pairs,
        R_s=motor.stator_resistance,
        L_d=motor.q_axis_inductance,
        L_q=motor.q_axis_inductance,
        psi_f=motor.flux_linkage,
    )


def settled(motor, speed, bus, currents):
    """Torque [N m] and voltage amplitude [V] of a simulated drive, one of each for each current [A]."""
    parameters, electrical = machine_parameters(motor), motor.pole_pairs * speed
    period = min(0.08 / abs(electrical), 0.1 * motor.q_axis_inductance / motor.stator_resistance)
    linkage = motor.flux_linkage + motor.q_axis_inductance * currents[0]
    drive = model.Drive(
        converter=model.VoltageSourceConverter(u_dc=2.0 * bus),
        machine=model.SynchronousMachine(parameters, psi_s0=linkage),
        mechanics=model.ExternalRotorSpeed(lambda _: speed),
    )
    unused = control.CurrentReferenceCfg(parameters, max_i_s=1.0, k_fw=0.0)
    controller = control.CurrentVectorControl(
        parameters, unused, T_s=period, alpha_c=0.2 / period, sensorless=False
    )
    controller.ref.tau_M = lambda _: 0.0
    duration = (SETTLING + READING) * period
    controller.current_reference = HeldCurrents(currents, duration)
    controller.current_ctrl.u_i = 1j * electrical * linkage + motor.stator_resistance * currents[0]
    model.Simulation(drive, controller).simulate(t_stop=len(currents) * duration - 0.5 * period)
    stage = drive.machine.data.t / duration
    # A held sample turns beside the rotor: of its amplitude the share sin(x) / x acts.
    acting = np.sinc(electrical * period / (2 * math.pi))
    read = [(stage > index + 0.9) & (stage < index + 0.99) for index in range(len(currents))]
    torque = [drive.machine.data.tau_M[chosen].mean() for chosen in read]
    voltage = [acting * np.abs(drive.converter.data.u_cs[chosen]).mean() for chosen in read]
    for chosen, current in zip(read, currents, strict=True):
        assert np.abs(drive.machine.data.i_s[chosen] - current).max() < 5e-3 * abs(current)
    return np.array(torque), np.array(voltage)


def crossing(torque, voltage, limit):
    """Torque at which the voltage is ``limit``, between the measured points."""
    order = np.argsort(voltage)
    assert voltage[order[0]] < limit < voltage[order[-1]]
    return float(np.interp(limit, voltage[order], torque[order]))


def random_motor(seed, *, strongest=0.9):
    """A motor and a bus in proportions that a robot's drive has, far apart in size."""
    random = np.random.default_rng(seed)
    bus = random.uniform(24.0, 80.0)
    pole_pairs = int(random.integers(4, 24))
    flux_linkage, resistance = 10 ** random.uniform(-2.7, -1.6), 10 ** random.uniform(-1.5, 0.0)
    current = random.uniform(0.2, strongest) * phase_voltage_limit(bus) / resistance
    motor = PmsmParameters(
        pole_pairs=pole_pairs,
        stator_resistance=resistance,
        q_axis_inductance=min(1e-2, random.uniform(0.3, 0.9) * flux_linkage / current),
        flux_linkage=flux_linkage,
        peak_torque=1.5 * pole_pairs * flux_linkage * current,
        rotor_inertia=1e-4,
    )
    return motor, bus, random


def voltage_limited_speed(motor, bus, random, end):
    """A speed below no load at which the refined bound is below the current limit and not near zero."""
    for share in random.uniform(0.1, 0.95, 400):
        bound = torque_limits(motor, share * no_load_speed(motor, bus), bus)[end]
        if 0.15 < abs(bound) / motor.peak_torque < 0.97:
            return float(share * no_load_speed(motor, bus))
    return None


@pytest.mark.parametrize("seed", range(MOTORS))
def test_refined_envelope(seed):
    motor, bus, random = random_motor(seed)
    checked = 0
    for end in (0, 1):
        speed = voltage_limited_speed(motor, bus, random, end)
        if speed is None:
            continue
        bound = float(torque_limits(motor, speed, bus)[end])
        current = bound / motor.torque_constant
        torque, voltage = settled(motor, speed, bus, [1j * share * current for share in (0.94, 1.0, 1.04)])
        assert crossing(torque, voltage, phase_voltage_limit(bus)) == pytest.approx(bound, rel=0.01)
        checked += 1
    assert checked >= 1


@pytest.mark.parametrize("seed", range(MOTORS))
def test_flux_weakening_envelope(seed):
    """Along the current limit's circle, from the q axis toward weaker magnets."""
    motor, bus, random = random_motor(100 + seed, strongest=0.45)
    limit = motor.peak_torque / motor.torque_constant
    for share in random.uniform(0.7, 2.0, 200):
        speed = float(share * no_load_speed(motor, bus))
        bound = float(torque_limits(motor, speed, bus, "flux-weakening")[1])
        direct, quadrature = dq_currents(motor, bound, speed, bus)
        if 0.15 < bound / motor.peak_torque < 0.97 and math.hypot(direct, quadrature) > 0.999999 * limit:
            break
    else:
        pytest.fail("no speed at which both limits bind")
    middle = math.atan2(-direct, quadrature)
    angles = np.linspace(max(0.0, middle - 0.08), min(0.5 * math.pi, middle + 0.06), 5)
    torque, voltage = settled(motor, speed, bus, [1j * limit * np.exp(1j * angle) for angle in angles])
    assert crossing(torque, voltage, phase_voltage_limit(bus)) == pytest.approx(bound, rel=0.01)


def far_reaching_motor(seed):
    """A motor with little resistance whose current limit reaches the centre of the voltage disk."""
    random = np.random.default_rng(seed)
    pole_pairs, flux_linkage = int(random.integers(4, 24)), 10 ** random.uniform(-3.5, -3.0)
    inductance = 10 ** random.uniform(-5.7, -5.3)
    current = random.uniform(1.6, 2.5) * flux_linkage / inductance
    motor = PmsmParameters(
        pole_pairs=pole_pairs,
        stator_resistance=max(1e-4, inductance / 0.04),
        q_axis_inductance=inductance,
        flux_linkage=flux_linkage,
        peak_torque=1.5 * pole_pairs * flux_linkage * current,
        rotor_inertia=1e-4,
    )
    return motor, random.uniform(24.0, 80.0)


@pytest.mark.parametrize("seed", range(400, 406))
def test_loci(seed):
    """MTPA and MTPV of motulator's own tables, which leave the resistance out."""
    motor, bus = far_reaching_motor(seed)
    table = control.TorqueCharacteristics(machine_parameters(motor))
    limit = motor.peak_torque / motor.torque_constant
    along = table.mtpa_locus(limit, N=9)
    for current, torque in zip(along.i_s[1:], along.tau_M[1:], strict=True):
        ours = dq_currents(motor, torque, 1.0, bus)
        assert complex(ours.direct, ours.quadrature) == pytest.approx(current, abs=1e-9 * limit)
    along = table.mtpv_locus(max_i_s=limit, N=9)
    for flux, current, torque in zip(along.psi_s[1:-1], along.i_s[1:-1], along.tau_M[1:-1], strict=True):
        speed = phase_voltage_limit(bus) / abs(flux) / motor.pole_pairs
        bound = torque_limits(motor, speed, bus, "flux-weakening")[1]
        assert bound == pytest.approx(torque, rel=0.01)
        ours = dq_currents(motor, bound, speed, bus)
        assert complex(ours.direct, ours.quadrature) == pytest.approx(current, abs=0.01 * abs(current))
