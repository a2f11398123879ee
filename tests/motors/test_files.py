import hypothesis.strategies as st
import pytest
from hypothesis import HealthCheck, given, settings

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import PmsmParameters, load_motor, save_motor

GOOD = """[motor]
pole_pairs = 21
stator_resistance = 0.1163
q_axis_inductance = 67.2e-6
flux_linkage = 6.08e-3
peak_torque = 15.0
saturation = 0.15
rotor_inertia = 6.94e-4
"""


@pytest.fixture
def motor_file(tmp_path):
    def write(text):
        path = tmp_path / "motor.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@given(st.from_type(PmsmParameters))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_saved_motor_is_read_back_exactly(tmp_path, motor):
    save_motor(motor, tmp_path / "motor.toml")
    assert load_motor(tmp_path / "motor.toml") == motor


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("67.2e-6", "0.0672", r"motor\.q_axis_inductance = 0\.0672 .* H"),
        ("peak_torque", "peek_torque", r"motor\.peek_torque = 15\.0 .* choose among pole_pairs, "),
        ("peak_torque = 15.0\n", "", r"motor\.peak_torque = None .* missing"),
        ("[motor]", "[engine]", r"\['engine'\] .*\[motor\]"),
    ],
)
def test_bad_file_is_refused_with_field_value_and_what_is_allowed(motor_file, surrogate, old, new, message):
    assert load_motor(motor_file(GOOD)) == surrogate
    path = motor_file(GOOD.replace(old, new))
    with pytest.raises(InvalidValueError, match=message) as caught:
        load_motor(path)
    assert str(path) in str(caught.value)
