import dataclasses
import math

import numpy as np
import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import PmsmParameters, stack_motors

IMPOSSIBLE = [
    ("pole_pairs", 0),
    ("pole_pairs", -21),
    ("pole_pairs", 2.5),
    ("pole_pairs", math.nan),
    ("stator_resistance", 0.0),
    ("stator_resistance", -0.1),
    ("stator_resistance", 116.3),  # milliohm
    ("stator_resistance", 20.0),  # milliohm of a large motor
    ("q_axis_inductance", -67e-6),
    ("q_axis_inductance", 0.0672),  # millihenry
    ("q_axis_inductance", 0.009),  # millihenry of a large motor
    ("q_axis_inductance", 67.2),  # microhenry
    ("flux_linkage", 0.0),
    ("flux_linkage", 6.08),  # milliweber
    ("peak_torque", 0.0),
    ("peak_torque", -15.0),
    ("peak_torque", 15000.0),  # newton millimetre
    ("peak_torque", 1500.0),  # newton centimetre
    ("saturation", 0.5),
    ("saturation", 0.7),
    ("saturation", -0.01),
    ("rotor_inertia", 0.0),
    ("rotor_inertia", 6.94),  # kg cm^2
    ("rotor_inertia", 6940.0),  # g cm^2
]


@pytest.mark.parametrize(("field", "value"), IMPOSSIBLE)
def test_impossible_value_is_refused_by_name(surrogate, field, value):
    with pytest.raises(InvalidValueError) as caught:
        dataclasses.replace(surrogate, **{field: value})
    assert caught.value.field == field
    assert caught.value.value is value
    assert field in str(caught.value) and str(value) in str(caught.value)


@pytest.mark.parametrize("field", [field.name for field in dataclasses.fields(PmsmParameters)])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, "0.1", None, True, [0.1]])
def test_what_is_no_finite_number_is_refused(surrogate, field, value):
    with pytest.raises(InvalidValueError, match=field):
        dataclasses.replace(surrogate, **{field: value})


@pytest.mark.parametrize("library", ["numpy", "torch"])
@pytest.mark.parametrize(("field", "value"), IMPOSSIBLE)
def test_one_bad_element_of_an_array_is_refused(surrogate, library, field, value):
    asarray = pytest.importorskip(library).asarray
    good = float(getattr(surrogate, field))
    with pytest.raises(InvalidValueError, match=field):
        dataclasses.replace(surrogate, **{field: asarray([good, value, good])})


def test_arrays_that_do_not_fit_together_are_refused(surrogate):
    with pytest.raises(InvalidValueError, match=r"shapes.*broadcast"):
        dataclasses.replace(surrogate, peak_torque=np.full(3, 15.0), saturation=np.full(2, 0.1))


def test_empty_array_is_refused(surrogate):
    with pytest.raises(InvalidValueError, match=r"peak_torque.*at least one motor"):
        dataclasses.replace(surrogate, peak_torque=np.array([]))


def test_wrong_prefix_is_explained(surrogate):
    with pytest.raises(InvalidValueError, match=r"L / R is 0\.0774 s.*henry"):
        dataclasses.replace(surrogate, q_axis_inductance=0.009)


def test_unknown_and_missing_fields_are_refused():
    with pytest.raises(TypeError, match="resistance"):
        PmsmParameters(resistance=0.1)  # pyright: ignore[reportCallIssue]


def test_parameters_cannot_be_changed(surrogate):
    with pytest.raises(dataclasses.FrozenInstanceError):
        surrogate.peak_torque = 30.0


def test_torque_constant(surrogate):
    assert surrogate.torque_constant == pytest.approx(1.5 * 21 * 6.08e-3)


def test_stack_keeps_order(surrogate):
    strong = dataclasses.replace(surrogate, peak_torque=18.0)
    np.testing.assert_array_equal(stack_motors([surrogate, strong]).peak_torque, [15.0, 18.0])


def test_empty_stack_is_refused():
    with pytest.raises(InvalidValueError, match="at least one motor"):
        stack_motors([])
