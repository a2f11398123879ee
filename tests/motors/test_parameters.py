import dataclasses
import math

import numpy as np
import pytest

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import Battery, Gear, I2tLimit, WindingHeat

IMPOSSIBLE = {
    "pole_pairs": [0, 2.5, math.nan],
    "stator_resistance": [0.0, 20.0, 116.3],  # milliohm
    "q_axis_inductance": [-67e-6, 0.009, 67.2],  # millihenry, microhenry
    "flux_linkage": [0.0, 6.08],  # milliweber
    "peak_torque": [-15.0, 1500.0, True, "15"],  # newton centimetre
    "saturation": [0.5, -0.01, None],
    "rotor_inertia": [0.0, 6.94, math.inf],  # kg cm^2
}


@pytest.mark.parametrize("field", IMPOSSIBLE)
def test_impossible_value_is_refused_by_name(surrogate, field):
    good = float(getattr(surrogate, field))
    for value in IMPOSSIBLE[field]:
        with pytest.raises(InvalidValueError, match=field) as caught:
            dataclasses.replace(surrogate, **{field: value})
        assert caught.value.value is value and str(value) in str(caught.value)
        if isinstance(value, float):
            with pytest.raises(InvalidValueError, match=field):
                dataclasses.replace(surrogate, **{field: np.array([good, value, good])})


def test_wrong_prefix_is_explained(surrogate):
    with pytest.raises(InvalidValueError, match=r"L / R is 0\.0774 s.*henry"):
        dataclasses.replace(surrogate, q_axis_inductance=0.009)


GEAR = {"ratio": 6.0, "efficiency": 0.95}
I2T = {"continuous_current": 5.0, "time_constant": 1.0}


@pytest.mark.parametrize(
    ("make", "values", "message"),
    [
        (Gear, GEAR | {"ratio": -6.0}, "ratio"),
        (Battery, {"internal_resistance": 75.0}, r"battery.internal_resistance"),  # milliohm
        (Battery, {"charge_table": (0.0, 0.5, 0.4, 1.0)}, "must rise"),
        (WindingHeat, {"heat_capacity": 0.0}, r"heat.heat_capacity"),
        (I2tLimit, I2T | {"continuous_current": 0.0}, r"i2t.continuous_current"),
        (I2tLimit, {"continuous_current": 5.0}, "give peak_duration or time_constant"),
    ],
)
def test_impossible_parts_are_refused_by_field(make, values, message):
    with pytest.raises(InvalidValueError, match=message):
        make(**values)
