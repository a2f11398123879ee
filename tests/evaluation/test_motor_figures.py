"""The picture of a motor's envelopes: closed where the voltage ends, labels inside."""

import numpy as np
import pytest

from sprintlab.evaluation.motor_figures import LABELS, workbench_figure
from sprintlab.motors import Gear, PmsmParameters
from sprintlab.motors.chart import JointDrive


@pytest.fixture(params=[310.0, 12.0])
def drive(request):
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
    return JointDrive(motor=motor, gear=Gear(ratio=1.0, efficiency=1.0), bus_voltage=request.param)


def curves(axis, model):
    """Upper and lower end of an envelope as drawn."""
    labels = [line.get_label() for line in axis.get_lines()]
    first = labels.index(LABELS[model])
    return [np.column_stack(axis.get_lines()[index].get_data()).T for index in (first, first + 1)]


@pytest.mark.parametrize("model", ["refined", "simplified-dc", "flux-weakening", "square"])
def test_an_envelope_closes_unless_it_leaves_the_picture(drive, model):
    figure = workbench_figure(drive, "servo")
    axis = figure.axes[0]
    upper, lower = curves(axis, model)
    assert np.isfinite(upper).all()
    assert np.isfinite(lower).all()
    right = axis.get_xlim()[1]
    gap = abs(upper[1, -1] - lower[1, -1]) / (2.0 * drive.peak_torque)
    assert upper[0, -1] == pytest.approx(right) or gap < 1e-3
