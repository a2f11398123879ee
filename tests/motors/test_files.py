import dataclasses

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.motors import PmsmParameters, load_motor, load_supply, save_motor, stack_motors

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


def test_arrays_survive(tmp_path, surrogate):
    stacked = stack_motors([surrogate, dataclasses.replace(surrogate, peak_torque=18.0)])
    save_motor(stacked, tmp_path / "motor.toml")
    loaded = load_motor(tmp_path / "motor.toml")
    for field in dataclasses.fields(PmsmParameters):
        np.testing.assert_array_equal(getattr(loaded, field.name), getattr(stacked, field.name))


def test_hand_written_file_is_read(motor_file, surrogate):
    assert load_motor(motor_file(GOOD)) == surrogate


def test_saturation_may_be_left_out(motor_file):
    assert load_motor(motor_file(GOOD.replace("saturation = 0.15\n", ""))).saturation == 0.0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("67.2e-6", "0.0672", r"motor\.q_axis_inductance = 0\.0672 .* H"),
        ("0.1163", "116.3", r"motor\.stator_resistance = 116\.3 .* ohm"),
        ("0.1163", "-0.1", r"motor\.stator_resistance = -0\.1"),
        ("0.15", "0.5", r"motor\.saturation = 0\.5 .*\[0, 0\.5\)"),
        ("15.0", "nan", r"motor\.peak_torque = nan .* finite"),
        ("15.0", "inf", r"motor\.peak_torque = inf .* finite"),
        ("15.0", "'15'", r"motor\.peak_torque = '15'"),
        ("15.0", "true", r"motor\.peak_torque = True"),
        ("15.0", "['a', 'b']", r"motor\.peak_torque = .*finite number"),
        ("15.0", "[true, false]", r"motor\.peak_torque = .*"),
        ("15.0", "[]", r"motor\.peak_torque = .*"),
        (
            "peak_torque",
            "peek_torque",
            r"motor\.peek_torque = 15\.0 .* choose among pole_pairs, .*peak_torque",
        ),
        ("peak_torque = 15.0\n", "", r"motor\.peak_torque = None .* missing"),
        ("[motor]", "[engine]", r"\['engine'\] .*\[motor\]"),
        ("[motor]", "version = 1\n[motor]", r"exactly one table"),
    ],
)
def test_bad_file_is_refused_with_field_value_and_what_is_allowed(motor_file, old, new, message):
    path = motor_file(GOOD.replace(old, new))
    with pytest.raises(InvalidValueError, match=message) as caught:
        load_motor(path)
    assert str(path) in str(caught.value)


def test_no_toml_is_refused(motor_file):
    with pytest.raises(SprintlabError, match="not a TOML file"):
        load_motor(motor_file("motor: {pole_pairs: 21}"))


def test_binary_file_is_refused(tmp_path):
    (tmp_path / "motor.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SprintlabError, match="not text in UTF-8"):
        load_motor(tmp_path / "motor.toml")


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(SprintlabError, match="cannot read"):
        load_motor(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("table", "field", "value"),
    [
        ("heat", "heat_capacity", "5e-324"),
        ("heat", "thermal_resistance", "1e308"),
        ("i2t", "continuous_current", "1e308"),
        ("i2t", "peak_duration", "5e-324"),
        ("battery", "capacity", "5e-324"),
        ("battery", "voltage_table", "[1.0, 1e308]"),
    ],
)
def test_numbers_of_a_supply_at_which_arithmetic_ends_are_refused(tmp_path, table, field, value):
    """They were positive and finite; what was worked out from them was not."""
    needed = {"i2t": "continuous_current = 20.0\npeak_duration = 2.0\n", "battery": "charge_table = [0, 1]\n"}
    lines = [line for line in needed.get(table, "").splitlines() if not line.startswith(field)]
    (tmp_path / "supply.toml").write_text("\n".join([f"[{table}]", *lines, f"{field} = {value}"]))
    with pytest.raises(InvalidValueError, match=f"{field} = .* must lie in"):
        load_supply(tmp_path / "supply.toml")
