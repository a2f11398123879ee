"""The flags that choose the drive a policy is measured on."""

import pytest

from sprintlab.api.drive import DriveOptions
from sprintlab.motors import Battery, HousedHeat, I2tLimit, WindingHeat
from sprintlab.plant import PlantOptions


def test_without_flags_it_is_the_published_plant():
    assert DriveOptions().plant() == PlantOptions()
    assert DriveOptions().plant().remarks == ()


def test_flags_turn_on_what_they_name():
    flags = DriveOptions(motor_model="flux-weakening", battery=True, heat=True, state_of_charge=0.4)
    plant = flags.plant()
    assert plant.motor_model == "flux-weakening"
    assert (plant.battery, plant.heat) == ("robot", WindingHeat())
    assert plant.state_of_charge == 0.4
    assert [remark.split()[0] for remark in plant.remarks] == ["motor", "a", "windings"]


def test_a_supply_file_turns_on_what_it_holds(tmp_path):
    path = tmp_path / "pack.toml"
    path.write_text("[battery]\nseries_cells = 12\ninternal_resistance = 0.05\n")
    plant = DriveOptions(supply=path).plant()
    assert plant.battery == Battery(series_cells=12, internal_resistance=0.05)
    assert plant.heat is None
    path.write_text(f"[heat]\nheat_capacity = {[60.0] * 12}\n")
    plant = DriveOptions(supply=path).plant()
    assert plant.battery is None
    assert plant.heat is not None and plant.heat.heat_capacity.shape == (12,)
    path.write_text("[heat]\nhousing_heat_capacity = 80.0\nhousing_thermal_resistance = 1.5\n")
    housed = HousedHeat(housing_heat_capacity=80.0, housing_thermal_resistance=1.5)
    assert DriveOptions(supply=path).plant().heat == housed
    path.write_text("[i2t]\ncontinuous_current = 20.0\npeak_duration = 2.0\n")
    plant = DriveOptions(supply=path).plant()
    assert plant.i2t == I2tLimit(continuous_current=20.0, peak_duration=2.0)
    assert (plant.battery, plant.heat) == (None, None)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "must hold the tables"),
        ("[cell]\nvolts = 3\n", "must hold the tables"),
        ("battery = 3\n", "battery = 3"),
        ("[battery]\nresistance = 1\n", "battery.resistance"),
        ("[battery]\nseries_cells = 'x'\n", "battery.series_cells"),
        ("[battery]\nvoltage_table = [3.0, 4.2]\n", "one voltage for each charge"),
        ("[battery]\nvoltage_table = [3.0, 'x']\n", "battery.voltage_table"),
        ("[heat]\nmagnet_share = 3\n", "heat.magnet_share"),
        ("[heat]\nheat_capacity = ['a']\n", "heat"),
        ("[heat]\nhousing_heat_capacity = 80\n", "heat"),
        ("[i2t]\ncontinuous_current = 20.0\n", "give peak_duration or time_constant"),
        ("[i2t]\ntime_constant = 2.0\n", "i2t"),
        ("[i2t]\ncontinuous_current = -1\ntime_constant = 2.0\n", "i2t.continuous_current"),
        ("[battery\n", "not a TOML file"),
    ],
)
def test_a_bad_supply_file_is_refused_in_one_sentence(call, tmp_path, text, message):
    path = tmp_path / "pack.toml"
    path.write_text(text)
    outcome = call("race", "--supply", path)
    assert outcome.status == 2
    assert message in outcome.err
    assert outcome.err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--motor-model", "cubic"), "plant.motor_model"),
        (("--battery", "--state-of-charge", 50), "plant.state_of_charge"),
        (("--heat", "--winding-temperature", 400), "plant.winding_temperature"),
        (("--supply", "missing.toml"), "cannot read supply file missing.toml"),
    ],
)
@pytest.mark.parametrize("command", ["race", "evaluate"])
def test_a_bad_flag_is_refused_in_one_sentence(call, command, arguments, message):
    outcome = call(command, "sprint", *arguments)
    assert outcome.status == 2
    assert message in outcome.err
