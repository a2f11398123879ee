"""A data sheet in any convention gives the motor it was written from; what is unclear or wrong is named."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sprintlab.core.errors import SprintlabError
from sprintlab.motors import I2tLimit, PmsmParameters, i2t_time_constant, load_supply
from sprintlab.workbench.datasheet import (
    conversion_numbers,
    convert_datasheet,
    save_converted_supply,
)
from sprintlab.workbench.datasheet_file import (
    CURRENTS,
    VOLTAGES,
    read_datasheet,
)

RPM = 60.0 / (2.0 * math.pi)
MOTOR = PmsmParameters(
    pole_pairs=7,
    stator_resistance=0.2,
    q_axis_inductance=1.2e-4,
    flux_linkage=5e-3,
    peak_torque=1.5 * 7 * 5e-3 * 30.0,
    rotor_inertia=3e-5,
)


def winding_voltage(amplitude, convention, connection):
    """A star's phase EMF of this amplitude, as an instrument of this convention reads it on the motor."""
    lines = math.sqrt(3.0) * amplitude
    if convention == "dc" or convention.startswith("line-to-line"):
        value = lines
    else:
        value = lines if connection == "delta" else amplitude
    return value / math.sqrt(2.0) if convention.endswith("rms") else value


def winding_current(amplitude, convention, connection):
    """A line current of this amplitude, as an instrument of this convention reads it on the motor."""
    if convention == "dc":
        return amplitude * math.sqrt(3.0) / 2.0
    value = amplitude
    if convention.startswith("phase") and connection == "delta":
        value = amplitude / math.sqrt(3.0)
    return value / math.sqrt(2.0) if convention.endswith("rms") else value


def sheet_of(motor, voltage="dc", current="line rms", connection="star", between="lines", **changes):
    """The entries that a maker would print for a motor."""
    emf_constant = motor.pole_pairs * motor.flux_linkage
    peak = motor.peak_torque / motor.torque_constant
    share = {"lines": 2.0, "phase": 3.0 if connection == "delta" else 1.0}[between]
    per_ampere = motor.torque_constant / winding_current(1.0, current, connection)
    table = {
        "poles": 2 * motor.pole_pairs,
        "connection": connection,
        "resistance": {"value": f"{share * motor.stator_resistance!r} ohm", "between": between},
        "inductance": {"value": f"{1e6 * share * motor.q_axis_inductance!r} uH", "between": between},
        "kv": {
            "value": f"{RPM / winding_voltage(emf_constant, voltage, connection)!r} rpm/V",
            "voltage": voltage,
        },
        "torque_constant": {"value": f"{1e3 * per_ampere!r} mN m/A", "current": current},
        "peak_current": {"value": f"{winding_current(peak, current, connection)!r} A", "current": current},
        "rotor_inertia": f"{1e7 * motor.rotor_inertia!r} g cm^2",
    }
    table.update(changes)
    return {key: value for key, value in table.items() if value is not None}


def convert(table):
    return convert_datasheet(read_datasheet(table))


def same(found, motor):
    for name in ("stator_resistance", "q_axis_inductance", "flux_linkage", "peak_torque", "rotor_inertia"):
        assert getattr(found, name) == pytest.approx(getattr(motor, name), rel=1e-9), name
    assert found.pole_pairs == motor.pole_pairs


@given(
    motor=st.from_type(PmsmParameters),
    voltage=st.sampled_from([*VOLTAGES, "dc"]),
    current=st.sampled_from(CURRENTS),
    connection=st.sampled_from(["star", "delta"]),
    between=st.sampled_from(["lines", "phase"]),
)
def test_every_convention_leads_back_to_the_motor(motor, voltage, current, connection, between):
    same(convert(sheet_of(motor, voltage, current, connection, between)).motor, motor)


def test_missing_conventions_are_all_named_with_what_they_would_mean():
    table = sheet_of(MOTOR, torque_constant="52.5 mN m/A")
    table["resistance"] = "0.4 ohm"
    with pytest.raises(SprintlabError) as caught:
        convert(table)
    message = str(caught.value)
    assert "resistance = '0.4 ohm' does not say which: between = 'lines', 'phase'" in message
    assert "'line amplitude' (psi = 5 mWb, as kv)" in message
    assert "'line rms' (psi = 3.536 mWb)" in message


def test_a_sheet_without_a_constant_of_the_motor_is_told_which_would_do():
    table = sheet_of(MOTOR)
    for name in ("kv", "back_emf_constant", "torque_constant"):
        table.pop(name, None)
    with pytest.raises(SprintlabError, match=r"^datasheet\.kv is missing: give one of .*torque_constant"):
        convert(table)


def test_constants_may_be_taken_behind_the_gear():
    """A geared motor's sheet gives its speed and torque constants at the output."""
    table = sheet_of(MOTOR, gear_ratio=36.0)
    kv, constant = (table[name]["value"].split() for name in ("kv", "torque_constant"))
    table["kv"] = {"value": f"{float(kv[0]) / 36.0!r} rpm/V", "voltage": "dc", "at": "output"}
    torque = f"{36.0 * float(constant[0])!r} mN m/A"
    table["torque_constant"] = {"value": torque, "current": "line rms", "at": "output"}
    emf = f"{36.0 * MOTOR.pole_pairs * MOTOR.flux_linkage!r} V s/rad"
    table["back_emf_constant"] = {"value": emf, "voltage": "phase amplitude", "at": "output"}
    same(convert(table).motor, MOTOR)


def test_peak_torque_and_current_give_the_saturation():
    table = sheet_of(MOTOR, peak_torque=f"{0.8 * MOTOR.peak_torque} N m")
    converted = convert(table)
    assert converted.motor.saturation == pytest.approx(0.2)
    assert converted.motor.peak_torque == pytest.approx(MOTOR.peak_torque)


def test_peak_and_continuous_values_make_the_drives_i2t(tmp_path):
    rated = {"value": f"{winding_current(12.0, 'line rms', 'star')!r} A", "current": "line rms"}
    sheet = sheet_of(MOTOR, rated_current=rated, peak_duration="3000 ms")
    conversion = convert_datasheet(read_datasheet(sheet))
    assert conversion.i2t.continuous_current == pytest.approx(12.0)
    assert conversion.i2t.peak_duration == 3.0
    save_converted_supply(conversion, tmp_path / "supply.toml")
    supply = load_supply(tmp_path / "supply.toml")
    assert (supply.battery, supply.heat, supply.i2t) == (None, None, conversion.i2t)
    assert conversion_numbers(conversion)["i2t"]["peak_duration"] == 3.0


def test_a_rated_torque_and_a_time_constant_do_as_well():
    saturated = sheet_of(MOTOR, rated_torque="0.5 N m", winding_time_constant="0.5 min", saturation=0.2)
    conversion = convert_datasheet(read_datasheet(saturated))
    current = conversion.i2t.continuous_current
    torque = current * conversion.motor.torque_constant
    assert torque * (1.0 - 0.2 * torque / conversion.motor.peak_torque) == pytest.approx(0.5)
    lasts = next(step.value for step in conversion.steps if step.quantity == "peak duration from cold")
    alike = I2tLimit(continuous_current=current, peak_duration=lasts)
    assert i2t_time_constant(alike, conversion.motor) == pytest.approx(30.0)


def test_four_thermal_entries_make_winding_and_housing(tmp_path):
    thermal = {
        "winding_thermal_resistance": "6.64 K/W",
        "housing_thermal_resistance": "2.5 degC/W",
        "winding_time_constant": "43.16 s",
        "housing_time_constant": "2 min",
    }
    conversion = convert_datasheet(read_datasheet(sheet_of(MOTOR, **thermal)))
    heat = conversion.heat
    assert (heat.heat_capacity, heat.thermal_resistance) == (pytest.approx(6.5), 6.64)
    assert (heat.housing_heat_capacity, heat.housing_thermal_resistance) == (pytest.approx(48.0), 2.5)
    save_converted_supply(conversion, tmp_path / "supply.toml")
    assert load_supply(tmp_path / "supply.toml").heat == heat
    del thermal["housing_thermal_resistance"]
    assert convert_datasheet(read_datasheet(sheet_of(MOTOR, **thermal))).heat is None
