"""Designs of a robot: the winding's law, the inverter's limit, and the choice."""

import numpy as np
import pytest

from sprintlab.motors import copper_loss, saturate, torque_limits
from sprintlab.robots import load_robot, load_robot_file, read_table, robot_table_path
from sprintlab.speed_limit.designs import (
    MODELS,
    all_designs,
    choose,
    design_name,
    parse_variations,
    peak_current,
    redesigned,
    write_robot,
)


@pytest.fixture
def built(tmp_path):
    """BP2 with a design, through its table."""

    def build(design, current=None):
        rows = read_table(robot_table_path("bp2"))[1]
        path = tmp_path / design_name(design) / "parameters.toml"
        write_robot(path, "designed", redesigned(rows, design, current), "bp2")
        return load_robot_file(path)

    return build


@pytest.mark.parametrize("turns", [0.7, 1.3])
def test_turns_act_as_a_bus_of_the_inverse_voltage_at_the_same_heat_and_mass(built, turns):
    own, wound = load_robot("bp2"), built({"winding": turns})
    speed = np.linspace(-300.0, 300.0, 25)[:, None]
    for model in MODELS:
        limits = torque_limits(wound.motors, speed, own.bus_voltage, model)
        expected = torque_limits(own.motors, speed, own.bus_voltage / turns, model)
        np.testing.assert_allclose(limits, expected, rtol=1e-9, atol=1e-9)
    torque = np.full(len(own.joint_names), 5.0)
    np.testing.assert_allclose(copper_loss(wound.motors, torque), copper_loss(own.motors, torque))
    assert peak_current(wound) == pytest.approx(peak_current(own) / turns)
    assert wound.total_mass == own.total_mass


def test_a_gear_takes_its_rotor_along_and_leaves_other_joints_alone(built):
    own, geared = load_robot("bp2"), built({"gear.hip": 11.0})
    assert np.unique(np.asarray(geared.gear.ratio)).tolist() == [6.0, 7.75, 11.0]
    assert geared.armature[1] == pytest.approx(own.armature[1] * (11.0 / 8.25) ** 2)
    assert geared.armature[2] == own.armature[2]


def test_an_inverter_cuts_the_peak_torque_and_leaves_the_iron_as_it_is(built):
    own = load_robot("bp2")
    most = 0.8 * peak_current(own)
    cut = built({"winding": 1.0}, most)
    assert peak_current(cut) == pytest.approx(most)
    torque = np.full(len(own.joint_names), 0.7 * 12.0)
    np.testing.assert_allclose(saturate(cut.motors, torque), saturate(own.motors, torque))
    assert built({"winding": 1.5}, most).motors.peak_torque == pytest.approx(own.motors.peak_torque)


def test_variations_are_ranges_or_lists_and_make_all_combinations():
    varied = parse_variations(["gear.hip=6:11", "winding=0.8:1:2"])
    assert parse_variations(["winding=0.8,1"])["winding"] == varied["winding"]
    assert varied == {"gear.hip": (6.0, 7.0, 8.0, 9.0, 10.0, 11.0), "winding": (0.8, 1.0)}
    assert len(all_designs(varied)) == 12 and all_designs(varied)[1] == {"gear.hip": 6.0, "winding": 1.0}
    assert design_name(all_designs(varied)[1]) == "gear.hip=6,winding=1"


def row(gear, refined, wrong, power=1000.0):
    numbers = {"spread_m_s": 0.1, "winding_degC": 60.0 + gear}
    models = {
        "refined": {"speed_m_s": refined, "power_W": power},
        "simplified-dc": {"speed_m_s": wrong, "power_W": 1.0},
    }
    return {"design": {"gear.hip": gear}, "limits": {name: numbers | found for name, found in models.items()}}


def test_each_model_chooses_by_its_own_speeds_and_the_refined_one_judges():
    found = choose([row(6.0, 13.0, 13.2, 900.0), row(8.0, 12.5, 14.0, 1100.0), row(9.0, 11.0, 13.0)])
    assert found.chosen == {"refined": {"gear.hip": 6.0}, "simplified-dc": {"gear.hip": 8.0}}
    assert found.cost("speed_m_s") == -0.5 and found.cost("power_W") == 200.0
    assert "costs 0.50 m/s, +200 W and +2.0 degC" in found.sentence()


def test_where_both_choose_the_same_design_the_sentence_says_what_each_training_holds_there():
    rows = [row(6.0, 14.9, 14.6), row(8.0, 14.5, 14.3)]
    assert (
        choose(rows)
        .sentence()
        .endswith("both motor models choose gear.hip=6, 14.90 m/s; v_d = 0 promises 14.60 m/s.")
    )
    trained = [
        {
            **each,
            "trained": {
                name: found | {"seeds": 1, "believed_m_s": found["speed_m_s"] + 0.2}
                for name, found in each["limits"].items()
            },
        }
        for each in rows
    ]
    said = choose(trained, trained=True).sentence()
    assert "(one seed each) both motor models choose gear.hip=6: " in said
    assert "v_d = 0 14.60 m/s of the 14.80 m/s" in said
