"""The picture of a motor's envelopes."""

import numpy as np
import pytest

from sprintlab.evaluation.motor_figures import LABELS, envelope_outline, workbench_figure
from sprintlab.motors import Gear, PmsmParameters
from sprintlab.motors.chart import JointDrive


@pytest.mark.parametrize("bus_voltage", [310.0, 12.0])
def test_every_envelope_is_a_closed_curve_in_the_picture(bus_voltage):
    """A servo on the bus it was made for, and on one that gives a quarter of its torque."""
    motor = PmsmParameters(
        pole_pairs=4,
        stator_resistance=1.535,
        q_axis_inductance=3.285e-3,
        flux_linkage=0.0703,
        peak_torque=8.1,
        saturation=0.19,
        rotor_inertia=1.8e-4,
    )
    drive = JointDrive(motor=motor, gear=Gear(ratio=1.0, efficiency=1.0), bus_voltage=bus_voltage)
    drawn = {line.get_label() for line in workbench_figure(drive, "servo").axes[0].get_lines()}
    for name, label in LABELS.items():
        speed, torque = envelope_outline(drive, name)
        assert label in drawn and np.isfinite(speed).all() and np.isfinite(torque).all()
        assert (speed[0], torque[0]) == (speed[-1], torque[-1])
        assert 0.0 < torque.max() <= drive.peak_torque + 1e-9 and speed.max() > 0.6 * drive.no_load_speed
