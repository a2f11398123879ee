"""The pages tell of the policies what the files below results hold."""

import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

from sprintlab.commands import KERB_DISTANCE, LANE_WIDTH
from sprintlab.control import load_policy, shipped_policies, shipped_policy
from sprintlab.evaluation.audit import AuditThresholds
from sprintlab.evaluation.robustness import CAUSES, wilson_interval

ROOT = Path(__file__).resolve().parents[2]


def looked_at(name):
    """What one look recorded of its trainings."""
    return json.loads((ROOT / f"results/{name}-looks/trainings.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def result_tables(load_script):
    return load_script("tools/result_tables.py")


@pytest.fixture(scope="module")
def speed_realism(load_script):
    return load_script("benchmarks/speed_realism.py")


def test_the_results_page_draws_every_policy_from_the_committed_numbers(result_tables):
    tables, races = result_tables.tables(), result_tables.policy_results("result.json")
    pages = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*.md"))
    assert set(re.findall(r"{{ (\w+) }}", pages)) == set(tables)
    assert set(races) == set(result_tables.policy_results("robustness.json")) == set(shipped_policies())
    summary, audit = tables["policy_summary"].splitlines()[2:], tables["policy_audit"].splitlines()
    for column, (row, (name, race)) in enumerate(zip(summary, races.items(), strict=True), start=2):
        items = race["audit"]["items"]
        assert f"`{name}`" in row and f"{race['held_speed_m_s']:.2f} m/s" in row
        failed = [item for item in items if not item["passed"]]
        assert f"**{len(failed)} of {len(items)} lines fail**" in row or not failed
        for item, line in zip(items, audit[-len(items) :], strict=True):
            cells = line.split("|")
            assert cells[1].strip().startswith(item["name"]) and ("**" in cells[column]) != item["passed"]


def test_five_seeds_stand_in_one_table_and_the_page_says_that_the_median_is_not_shipped(result_tables):
    rows = result_tables.tables()["training_seeds"].splitlines()[2:]
    speeds = [float(re.findall(r"[\d.]+ m/s", row)[0].split()[0]) for row in rows]
    assert len(rows) == 5 and "shipped" in rows[0] and "| passed |" in rows[0]
    assert speeds == sorted(speeds, reverse=True) and all("| fails " in row for row in rows[1:])
    page = (ROOT / "docs/results.md").read_text(encoding="utf-8")
    assert (
        page.count(f"median holds {speeds[2]:.2f} m/s") == page.count(f"which holds {speeds[2]:.2f} m/s") == 1
    )


def test_every_reward_term_that_is_not_the_papers_has_its_reason(result_tables, monkeypatch):
    table = result_tables.reward_departures()
    assert "| foot force | - | -0.5, then -4 |" in table and "| collision | -1, then 0 | -1 |" in table
    monkeypatch.delitem(result_tables.WHY_NOT_THE_PAPERS, "progress")
    with pytest.raises(ValueError, match="progress"):
        result_tables.reward_departures()


@pytest.mark.parametrize("name", shipped_policies())
def test_the_results_are_those_of_the_policies_that_come_with_the_package(name, result_tables):
    """By the digest of the file: whoever replaces a policy measures it anew."""
    digest = hashlib.sha256(shipped_policy(name).read_bytes()).hexdigest()
    race = result_tables.policy_results("result.json")[name]
    assert race["facts"]["policy SHA-256"] == digest and race["robot"] == shipped_robot(name)
    engines = json.loads((ROOT / "results/second_engine/speeds.json").read_text(encoding="utf-8"))["policies"]
    assert engines[digest]["top_speed_command_m_s"] == race["top_speed_command_m_s"]
    found = result_tables.policy_results("robustness.json")[name]
    assert found["top_speed_command_m_s"] == race["top_speed_command_m_s"], "one top speed everywhere"
    assert found["interval_95"] == pytest.approx(wilson_interval(found["upright"], found["trials"]))


def shipped_robot(name):
    return load_policy(shipped_policy(name)).contract.robot_name


def test_the_figure_has_every_look_after_the_policies_with_trials_of_their_own(speed_realism):
    named = {look for group in speed_realism.LOOKS for look, _ in group.parts}
    committed = {path.name.removesuffix("-looks") for path in (ROOT / "results").glob("*-looks")}
    assert committed - named == {"first", "second", "third"}, "their policies have trials of their own"
    for group in speed_realism.LOOKS:
        points = group.points(ROOT / "results")
        assert points and all("foot_force_body_weights" in point for point in points)
    by_look = {group.parts[0][0]: group.points(ROOT / "results") for group in speed_realism.LOOKS}
    for look in ("sixth", "eighth"):
        assert all("stride_frequency_Hz" in point for point in by_look[look]), "under its other name"
    seeds = [point["speed_m_s"] for point in speed_realism.SEEDS.points(ROOT / "results")]
    assert sorted(seeds) == [9.36, 10.899, 11.61, 11.956]


def test_what_the_page_says_of_the_later_trainings_is_in_them(flowing):
    found = looked_at("second")
    page, policies = flowing("docs/results.md"), found["policies"]
    shipped, audited = (
        found["penalty_factors"]["policies"][name]
        for name in (
            "seed 1, its weights",
            "seed 1, stance 26 ms, stride 0.183 s, foot force 3.4 body weights, electrical power 0.6",
        )
    )
    slow, fast = shipped["8.0"]["factor"], shipped["12.0"]["factor"]
    assert f"by {slow:.2f} at a command of 8 m/s, by {fast:.2f} at 12" in page
    assert f"it is {audited['8.0']['factor']:.2f} and {audited['12.0']['factor']:.2f}" in page
    assert list(shipped["12.0"]["gain_without"])[:2] == ["electrical_power", "short_stances"]
    asked = found["asked_to_stand"]
    assert f"{100 * asked['heading_held']:.1f} % of the steps" in page
    assert f"speed: {100 * asked['heading_free']:.1f} %" in page
    for name, row in policies.items():
        met = [t for t in row["trials"] if t["self_paced"] or t["command_m_s"] <= 8.0]
        assert name == "E0" or max(abs(trial["estimate_bias_m_s"]) for trial in met) < 0.2
        left = min(abs(trial["speed_after_1_to_6_s_m_s"][-1]) for trial in row["trials"])
        assert (left > 2.0) == (name in ("A0", "A1", "B0", "C0")), "none of these ever stops"


def test_the_page_names_every_cause(flowing):
    page = flowing("docs/evaluation.md")
    for word in (
        "friction",
        "payload",
        "centre of mass",
        "strength",
        "bus voltage",
        "delay",
        "noise",
        "pads",
    ):
        assert word in page
    assert len(CAUSES) == 10


def test_the_evaluation_page_has_the_limits_of_the_audit(flowing):
    page, limits = flowing("docs/evaluation.md"), AuditThresholds()
    assert f"at most {limits.touchdowns_per_stride:g}" in page
    assert f"at most {limits.foot_force:g} body weights" in page
    assert f"at most {limits.gear_torque_ratio:g} x peak joint torque" in page
    assert f"at most {limits.joint_speed_ratio:g} x no-load" in page
    assert f"at most {limits.winding_temperature:g} °C" in page
    assert f"at most {1e3 * limits.pad_deflection:g} mm" in page
    assert f"at most {limits.lane_half_width:g} m" in page
    assert f"at most {limits.rest_speed:g} m/s" in page


def test_the_page_tells_where_the_front_ends(flowing, speed_realism):
    found = json.loads((ROOT / "results/speed_realism/trials.json").read_text(encoding="utf-8"))["policies"]
    later = [point for look in speed_realism.LOOKS for point in look.points(ROOT / "results")]
    trials = [trial for row in found.values() for trial in row["trials"] if not trial["fall"]]
    trials += [point for point in later if point["failed"] is not None]
    passed = max(trial["speed_m_s"] for trial in trials if not trial["failed"])
    fastest = max(trial["speed_m_s"] for trial in trials)
    page = flowing("docs/results.md")
    assert f"What passes ends at {passed:.1f} m/s, what runs at {fastest:.1f}." in page
    for trial in trials:
        clock = {"stride period from policy clock", "speed lost with another policy clock"}
        bound = ({"foot force"} | clock) & set(trial["failed"])
        assert trial["speed_m_s"] < passed + 1e-9 or bound, "the two reasons that the page names"
    known = [sum(name in point for point in later) for name in speed_realism.MEASURES]
    assert (
        f"of {len(later)} points {known[0]} have a cost of transport, {known[1]} a stride and {known[2]}"
        in page
    )
    later = looked_at("third")["policies"]
    assert all(row["stand"]["feet_airborne"] == 0.0 for row in later.values())
    assert set(later) < set(found) and len(found) == 28 and "Twenty-seven trainings and `sprint`" in page


def test_the_page_tells_why_lines_are_missed(flowing):
    found = json.loads((ROOT / "results/sprint/shortfalls.json").read_text(encoding="utf-8"))
    assert found["sha256"] == hashlib.sha256(shipped_policy("sprint").read_bytes()).hexdigest()
    page, groups = flowing("docs/results.md"), found["causes"] | found["networks"]
    assert not any(row["fall"] for rows in groups.values() for row in rows)
    runs = {name: {row["command_m_s"]: row for row in rows} for name, rows in groups.items()}
    speed_is_missed_by_peak_torque(page, runs)
    the_estimate_errs_as_one_network_does(page, runs)
    backward_no_limit_is_reached(page, runs)


HELD_BACK = (10.0, 11.0, 12.0)
"""Commands that the page speaks of [m/s]."""
WITHOUT_EFFECT = (
    "no voltage limit",
    "friction 1.2",
    "friction 0.6",
    "no pace, no turning loop",
)


def speed_is_missed_by_peak_torque(page, runs):
    speeds = {name: at(runs, name, HELD_BACK) for name in runs}
    own = speeds["as evaluated"]
    assert (
        f"it runs {listed(own)}; with 1.5 times the peak torque {listed(speeds['peak torque 1.5 times'])}"
        in page
    )
    assert f"too low gives {listed(speeds['estimate 1 m/s too low'])} alone" in page
    assert f"Without air it gains {listed(speeds['no air'] - own)}" in page
    assert f"told its true speed it runs {listed(own - speeds['estimate right'])} m/s slower" in page
    most = max(abs(speeds[cause] - own).max() for cause in WITHOUT_EFFECT)
    noise = abs(speeds["sensor noise"] - own).max()
    assert f"of its contract change it by at most {most:.2f}, noise by at most {noise:.2f}" in page
    assert f"asked for 13.25 m/s it holds {runs['as evaluated'][13.25]['speed_m_s']:.2f}" in page


def the_estimate_errs_as_one_network_does(page, runs):
    commands, other = (10.0, 12.0, 13.25), "the other network"
    read = [runs["as evaluated"][command]["read_from_the_same_inputs"] for command in commands]
    assert f"that network reads {listed([-each[other] for each in read])} m/s too little" in page
    assert f"`fast` {listed([-each['fast'] for each in read])}" in page
    assert f"alone it errs by {listed(-at(runs, other, commands, 'estimate_error_m_s'))}" in page
    errors = {name: at(runs, name, HELD_BACK, "estimate_error_m_s") for name in runs}
    most = max(abs(errors[cause] - errors["as evaluated"]).max() for cause in WITHOUT_EFFECT)
    noise = abs(errors["sensor noise"] - errors["as evaluated"]).max()
    assert f"change the error by at most {most:.2f}, noise by at most {noise:.2f}" in page


def backward_no_limit_is_reached(page, runs):
    own, asked = runs["as evaluated"], (-2.0,)
    assert f"{own[-2.0]['speed_m_s']:.2f} m/s when asked for -2, {own[-3.0]['speed_m_s']:.2f} when" in page
    assert f"asked for -5 it runs {own[-5.0]['speed_m_s']:.2f} m/s" in page
    assert own[-2.0]["most_limited_joint_share"] == 0.0
    alone = [runs[name][-2.0]["speed_m_s"] for name in ("fast", "the other network")]
    assert f"alone run {listed(alone)} m/s" in page and max(alone) < own[-2.0]["speed_m_s"]
    assert f"told its true speed it runs {runs['estimate right'][-2.0]['speed_m_s']:.2f}" in page
    speeds = [
        at(runs, cause, asked)
        for cause in (*WITHOUT_EFFECT, "sensor noise", "no air", "peak torque 1.5 times")
    ]
    assert max(abs(speed - at(runs, "as evaluated", asked)).max() for speed in speeds) < 0.02


def at(runs, name, commands, quantity="speed_m_s"):
    """A quantity of the runs under one name; NaN where a command was not run."""
    return np.array([runs[name].get(command, {}).get(quantity, np.nan) for command in commands])


def listed(values):
    *first, last = (f"{value:.2f}" for value in values)
    return f"{', '.join(first)} and {last}"


def test_the_page_tells_what_the_mean_of_two_networks_does(flowing):
    found = looked_at("fourth")
    (race,), randomized = found["races"]["average"], found["randomized_sprints"]
    page = flowing("docs/results.md")
    assert not race["failed"] and race["falls"] == race["not_stopped"] == 0
    assert f"in equal parts they hold {race['speed_m_s']:.2f} m/s" in page
    assert (
        f"{race['stride_frequency_Hz']:.2f} strides a second, stances of {race['stance_ms']:.0f} ms" in page
    )
    assert f"foot force {race['foot_force_body_weights']:.2f} and a cost of transport" in page
    assert f"100 m in {race['time_100m_s']:.2f} s" in page
    for name in ("R1", "S0", "average"):
        assert f"{randomized[name]['upright']} " in page and f" of {randomized[name]['trials']} " in page
    assert all("foot force" in race["failed"] for race in found["races"]["S0"])
    assert f"Drake says {found['drake']['average']['held_speed_m_s']:.2f} m/s" in page
    assert f"take {found['lap_with_battery_and_heat']['average']['time_s']:.1f} s" in page


def test_the_page_tells_what_stops_the_faster_policies(flowing):
    found = looked_at("fifth")
    page, policies = flowing("docs/results.md"), found["policies"]
    (fast,), (slower,) = found["races"]["fast"], found["races"]["slower"]
    assert load_policy(ROOT / "results/fifth-looks/fast.onnx").contract.robot_name == "bp2"
    assert abs(sum(found["averages"]["fast"].values()) - 1.0) < 1e-9 and fast["runs"] == 22
    assert f"holds {fast['speed_m_s']:.2f} m/s at {fast['command_m_s']:g}" in page
    assert f"100 m in {fast['time_100m_s']:.2f} s" in page
    assert f"It fails three lines**: {fast['foot_force_body_weights']:.2f} body weights" in page
    assert f"{fast['gear_torque_peak']:.1f} times its peak, and {fast['lane_m']:.2f} m from" in page
    assert len(fast["failed"]) == 3 and len(slower["failed"]) == 2 and not fast["falls"]
    assert f"({slower['speed_m_s']:.2f} m/s) fails" in page
    mirrored = [row["falls_per_1000_steps"] for name, row in policies.items() if name[0] in "XZ"]
    plain = [row["falls_per_1000_steps"] for name, row in policies.items() if name[0] == "Y"]
    assert f"falls {min(plain):.2f} to {max(plain):.2f} times" in page and min(mirrored) > 2 * max(plain)


def test_the_page_tells_what_other_seeds_of_the_recipe_give(flowing):
    found, later = (looked_at(looks) for looks in ("ninth", "tenth"))
    page, seeds = flowing("docs/results.md"), found["seeds"] | later["seeds"]
    practised = found["braking_practised"]["policies"]
    shipped = json.loads((ROOT / "results/sprint/result.json").read_text(encoding="utf-8"))
    assert max(row["held_raw_m_s"] for row in seeds.values()) < shipped["held_speed_m_s"]
    lane = seeds["3"]["worst"]["farthest foot from the lane's middle"]
    assert f"its lane by {lane - AuditThresholds().lane_half_width:.1f} m" in page
    assert all(row["failed"] for row in (*seeds.values(), *found["other_shares"].values()))
    upright = [row["alone"]["randomized"]["upright"] for row in practised.values()]
    assert f"Of 187 randomized sprints {', '.join(map(str, upright[:-1]))} and {upright[-1]} stay" in page
    assert all(row["half_and_half_with_sprint_fast"]["failed"] for row in practised.values())


def test_the_page_tells_what_each_term_left_out_does(flowing):
    found = looked_at("tenth")["left_out"]
    page = flowing("docs/results.md")
    named = {"no-progress": "reward for progress", "no-power": "electrical power"}
    named |= {"no-shock": "foot force and gear torque"}
    for lever, words in named.items():
        assert lever_row(words, found["levers"][lever]["seeds"], ("0", "1")) in page
    assert lever_row("nothing", found["all_levers"], ("0", "1")) in page
    barrier, whole = found["levers"]["no-barrier"]["seeds"], found["all_levers"]
    gain = mean_fastest(barrier) - mean_fastest(whole)
    assert f"{gain:.1f} m/s on average after 1196 iterations" in page


def test_the_page_tells_what_each_setting_changed_does(flowing):
    levers, page = {}, flowing("docs/results.md")
    for looks in ("eleventh", "twelfth"):
        found = looked_at(looks)
        for lever, row in found["left_out"]["levers"].items():
            levers.setdefault(lever, {**row, "seeds": {}})["seeds"].update(row["seeds"])
    named = {"no-yaw": "fine tracking of the yaw rate", "no-ramps": "ramps (ACS alone)"}
    named |= {"half-ramps": "ramps doubled (half of the targets)", "no-clock": "random clock"}
    named |= {"no-delay": "delay", "no-slopes": "slopes", "no-stops": "stop commands"}
    assert set(named) == set(levers)
    for lever, words in named.items():
        seeds = levers[lever]["seeds"]
        assert lever_row(words, seeds, sorted(seeds)) in page
    gains = [turn["gain"] for turns in levers["no-yaw"]["turns"].values() for turn in turns]
    assert (
        f"with at most {100 * max(gains):.0f} % of the yaw rate" in page
        and sum(gain < 0 for gain in gains) == 1
    )
    trials = [trial for seed in levers["no-ramps"]["seeds"].values() for trial in seed["trials"].values()]
    assert sum(trial["falls"] for trial in trials) == 0
    assert f"falls in none of {sum(trial['trials'] for trial in trials)} trials" in page
    jitters = [seed["clock"]["entries"] for seed in levers["no-clock"]["seeds"].values()]
    lost = [entries[0]["clock_held"] - entries[-1]["clock_held"] for entries in jitters]
    assert f"cost {lost[0]:.1f} and {lost[1]:.1f} m/s at the fastest command" in page
    assert not any(trial["complete"] for trial in levers["no-stops"]["seeds"]["0"]["trials"].values())
    assert all(seed["trials"]["13.0"]["falls"] for seed in levers["no-slopes"]["seeds"].values())


def test_the_page_tells_what_a_battery_in_the_recipe_does(flowing, result_tables):
    page = flowing("docs/results.md")
    rows = result_tables.battery_seeds().splitlines()[2:]
    speeds = [float(re.findall(r"[\d.]+ m/s", row)[0].split()[0]) for row in rows]
    throughout, first_half, harder = speeds[:5], speeds[5:10], speeds[10:]
    assert len(harder) == 5 and all("| fails " in row for row in rows[:5])
    told = f"hold {throughout[-1]:.1f} to {throughout[0]:.1f} m/s, {throughout[2]:.2f} in the median"
    assert told in page
    assert f"gives {first_half[-1]:.1f} to {first_half[0]:.1f} m/s.**" in page
    assert f"The median holds {first_half[2]:.2f} m/s, and that one, seed 4, passes" in page
    assert "seed 4" in rows[7] and "| passed |" in rows[7]
    told = f"give {harder[-1]:.1f} to {harder[0]:.1f} m/s**, {harder[2]:.2f} in the median. Seed 4 passes"
    assert told in page and "seed 4" in rows[13]
    assert [row.endswith("| passed |") for row in rows[10:]] == [False, False, False, True, False]
    later = looked_at("twelfth")
    means = later["other_means"]["means"]
    held, failed = ([mean[key] for mean in means] for key in ("held_raw_m_s", "failed"))
    assert f"hold {min(held):.1f} to {max(held):.1f} m/s and fail two to five" in page and len(means) == 9
    assert (min(map(len, failed)), max(map(len, failed))) == (2, 5)


def test_the_page_tells_how_the_fastest_of_the_recipes_with_a_battery_fails(flowing):
    found = looked_at("thirteenth")
    page, variants = flowing("docs/results.md"), found["second_halves"]["variants"]
    fastest = max(variants["stiff bus"]["means"], key=lambda row: row["held_raw_m_s"])
    worst = fastest["worst"]["foot force"]
    assert f"Seed {fastest['seed']} holds {fastest['held_raw_m_s']:.2f} m/s and runs the 100 m in" in page
    assert f"{fastest['time_100m_s'][0]:.2f} s with a cost of transport of" in page
    assert f"{fastest['cost_of_transport']:.2f}, but presses with {worst:.1f} body weights" in page
    softer = next(
        row for row in found["softer_feet"]["means"] if row["shares"] == {"where it began": 0.5, "A": 0.5}
    )
    told = f"{softer['held_raw_m_s']:.2f} m/s and still {softer['worst']['foot force']:.1f}."
    assert told in page and "foot force" in softer["failed"]
    shares = found["shares_of_the_fastest"]["means"]
    held, costs = ([row[key] for row in shares] for key in ("held_raw_m_s", "cost_of_transport"))
    assert f"{len(shares)} other shares of its networks hold {min(held):.1f} to {max(held):.1f} m/s" in page
    least = min(row["worst"]["foot force"] for row in shares)
    assert f"down to {min(costs):.2f}, but press with {least:.2f} body weights at least" in page
    assert least > AuditThresholds().foot_force
    keen = variants["stiff bus, harder limits, more for speed"]["means"][-1]
    limits = variants["stiff bus, harder limits"]["means"][-1]
    assert f"Seed 12 held {keen['held_raw_m_s']:.2f} m/s and passed eight runs" in page
    assert (keen["failed"], keen["runs"]) == ([], 8)
    assert f"without the reward {limits['held_raw_m_s']:.2f}, and out of its lane" in page
    assert "farthest foot from the lane's middle" in limits["failed"]


def test_the_page_tells_what_a_fifth_training_and_other_shares_bring(flowing):
    found = looked_at("fourteenth")
    page, shares = flowing("docs/results.md"), found["shares_of_seed_2"]
    fifth = found["fifth_trainings"]["means"]
    assert all(row["failed"] for row in fifth) and {row["seed"] for row in fifth} == {1, 2, 3, 12}
    assert f"holds up to {max(row['held_raw_m_s'] for row in fifth):.1f} m/s and fails the audit each" in page
    assert f"Of {len(shares['means'])} other shares of what seed 2 went through" in page
    assert f"the fastest holds {max(row['held_raw_m_s'] for row in shares['means']):.2f}." in page
    clocked = [row for row in shares["means"] if row["failed"] == ["stride period from policy clock"]]
    best = max(clocked, key=lambda row: row["held_raw_m_s"])
    told = f"One holds {best['held_raw_m_s']:.2f} m/s, runs the 100 m in {best['time_100m_s'][0]:.2f} s"
    assert told in page and best["runs"] == 10 and best["shares"] == found["clock_check"]["shares"]
    assert f"presses with {best['worst']['foot force']:.2f} body weights, its cost of transport is" in page
    cost = 100 * found["clock_check"]["greatest_loss_of_speed"]
    assert f"is {best['cost_of_transport']:.2f}, and other clocks cost it {cost:.1f} % at 14 m/s" in page


def test_the_page_tells_why_no_mean_of_a_fifth_training_is_shipped(flowing):
    found = looked_at("fourteenth")
    page, (calibrated,) = flowing("docs/results.md"), found["shares_of_seed_2"]["calibrated"]
    assert f"another one holds {calibrated['held_raw_m_s']:.2f} m/s, stops and keeps its lane" in page
    assert "foot force" in calibrated["failed"] and not calibrated["not_stopped"]
    assert f"a foot presses with {calibrated['worst']['foot force']:.1f} body weights" in page
    slower, seed_4 = found["randomized_seed_2"], found["randomized_seed_4"]["paces"]
    told = (
        f"at {slower['command_m_s']} m/s, {slower['upright']} of {slower['trials']} randomized sprints stay"
    )
    assert told in page and f"upright, at {slower['held_median_m_s']:.2f} m/s in the median" in page
    told = seed_4["as calibrated, --lead 2"]
    assert f"{told['upright']} of {told['trials']} randomized sprints stay upright with it" in page
    assert f"at {told['held_median_m_s']:.2f} m/s in the median" in page


def test_the_page_tells_what_passes_as_trained_and_not_as_calibrated(flowing):
    found = looked_at("fifteenth")
    page, shares = flowing("docs/results.md"), found["shares_of_seed_2"]
    further = {f"{name}, its tail" for name in found["further_trainings"]["trainings"]}
    assert f"Eight further trainings and {len(shares['means'])} other shares" in page and len(further) == 8
    limits = [row["foot_force_limit"] for row in found["further_trainings"]["trainings"].values()]
    high = [limit for limit in limits if limit > 2.5]
    told = f"Six of them punish only what exceeds {min(high)} to {max(high)} body weights"
    assert told in page and len(high) == 6
    softer = [row for row in shares["means"] if further & set(row["shares"])]
    upright = [row for row in softer if not row["falls"] and "held_raw_m_s" in row]
    assert f"hold up to {max(row['held_raw_m_s'] for row in upright):.2f} m/s" in page
    least = min(row["worst"]["foot force"] for row in upright)
    assert f"the softest of {len(softer)} presses with {least:.2f} body weights" in page
    others = [row for row in shares["means"] if row not in softer]
    passed = [row for row in others if not row["failed"]]
    assert len(passed) == 5 and f"Of the {len(others)} without, asked for 14.2 m/s, five pass" in page
    best = max(passed, key=lambda row: row["held_raw_m_s"])
    told = f"holds {best['held_raw_m_s']:.2f} m/s, {best['held_self_paced_m_s']:.2f} self-paced, and runs the"
    assert best["runs"] == 12 and f"{told} 100 m in {best['time_100m_s'][0]:.2f} s" in page
    held = [row["held_raw_m_s"] for row in shares["calibrated"]]
    foot = [row["worst"]["foot force"] for row in shares["calibrated"]]
    calibrated = {tuple(row["shares"].items()) for row in shares["calibrated"]}
    assert len(calibrated) == 6 and calibrated <= {tuple(row["shares"].items()) for row in others}
    assert len(held) == 12 and {row["runs"] for row in shares["calibrated"]} == {22}
    told = f"hold {min(held):.1f} to {max(held):.1f} m/s over 22 runs, and all press with"
    assert f"{told} {min(foot):.2f} to {max(foot):.2f} body weights" in page
    seeds = [row["held_raw_m_s"] for row in found["same_shares_of_other_seeds"]]
    assert f"hold {min(seeds):.1f} to {max(seeds):.1f} m/s and fail, too" in page and len(seeds) == 4
    assert all(row["failed"] for row in found["same_shares_of_other_seeds"])


def test_the_page_tells_what_the_fastest_calibrated_policy_can_and_cannot(flowing):
    found = looked_at("fifteenth")
    page, whole = flowing("docs/results.md"), found["fastest_calibrated_whole"]
    upright = whole["randomized"]["upright"]
    told = f"{upright} of {whole['randomized']['trials']} randomized sprints stay upright, at"
    assert f"{told} {whole['randomized']['held_median_m_s']:.2f} m/s in the median" in page
    own, slower, *_ = whole["clock_check"]["clocks"]
    assert f"One, measured whole at {own['held_speed_m_s']:.2f} m/s" in page
    assert f"its stride, {own['stride_frequency_Hz']:.2f} Hz, is locked" in page and own["locked"]
    assert slower["policy_rate_Hz"] == 48.0 and slower["completed"] == 1
    hot = whole["laps_with_battery_and_heat"][-1]
    told = f"takes {hot['time_s']:.1f} s and ends at {hot['hottest_winding_degC']:.0f} °C"
    assert told in page and hot["lane_kept"]
    lap = whole["laps"][0]
    assert f"a lap of {lap['time_s']:.1f} s is {lap['farthest_outward_m']:.2f} m wide of its line" in page
    beyond = 100 * (lap["farthest_outward_m"] - (LANE_WIDTH - KERB_DISTANCE))
    assert f"{beyond:.0f} cm beyond the lane" in page and not lap["lane_kept"]


def test_the_page_tells_what_braking_softly_at_speed_brings(flowing):
    found = looked_at("fifteenth")
    page, softly = flowing("docs/results.md"), found["braking_softly_at_speed"]
    race, sprints, lap = softly["race"], softly["randomized"], softly["lap"]
    told = f"{race['power_W_kg']} W/kg instead of {found['shares_of_seed_2']['calibrated'][0]['power_W_kg']}"
    assert f"{told} and in the end with {race['deceleration_m_s2']} m/s² instead of 5, holds" in page
    assert race["held_raw_m_s"] == race["held_self_paced_m_s"] and race["runs"] == 22
    assert f"holds {race['held_raw_m_s']:.2f} m/s raw and self-paced, runs the 100 m in" in page
    foot = race["worst"]["foot force"]
    assert f"in {race['time_100m_s'][0]:.2f} s and presses with {foot:.2f} body weights, the worst" in page
    assert race["failed"] == ["speed lost with another policy clock"]
    assert race["worst"]["speed lost with another policy clock"] == 1.0, "not every trial ended"
    assert {turn["command_speed_m_s"] for turn in softly["turning"]["falls"]} == {12.0}
    assert f"keeps its lane in takes {lap['time_s']:.1f} s" in page and lap["lane_kept"]
    told = f"{sprints['upright']} of {sprints['trials']} randomized sprints stay upright, at"
    assert f"{told} {sprints['held_median_m_s']:.2f} m/s in the median. So `sprint` stays." in page


def test_the_page_tells_what_braking_from_its_own_speed_does_to_sprint(flowing):
    found = looked_at("fifteenth")
    page, told = flowing("docs/results.md"), found["sprint_braking_from_its_speed"]
    sprints = told["randomized"]
    assert f"0.5 m/s above the estimated speed: {sprints['upright']};" in page and sprints["trials"] == 1000
    own, slower, *_ = told["clock_check"]["clocks"]
    cost = 100 * (1 - slower["held_speed_m_s"] / own["held_speed_m_s"])
    assert (slower["policy_rate_Hz"], slower["completed"]) == (48.0, 10)
    assert f"all ten trials with a clock of 48 Hz are at rest in time then, {cost:.1f} % slower" in page


def test_the_page_tells_how_many_randomized_sprints_fall_and_that_no_other_pace_is_surer(flowing):
    found = json.loads((ROOT / "results/sprint/robustness.json").read_text(encoding="utf-8"))
    page, fallen = flowing("docs/results.md"), found["trials"] - found["upright"]
    assert f"**{100 * found['upright'] / found['trials']:.1f} %** of {found['trials']} upright" in page
    assert f"median **{found['held_speed_quantiles_m_s']['0.5']:.2f}** m/s" in page
    assert f"Its {fallen} falls of {found['trials']} come" in page
    assert f"all {fallen} falls of {found['trials']} come as it brakes" in page
    looks = looked_at("thirteenth")
    paces = looks["paces_of_sprint"]
    softer = [paces[f"{power} W/kg, lead 2 m/s"] for power in (24, 20)]
    upright = " and ".join(str(row["randomized"]["upright"]) for row in softer)
    assert f"24 and 20 W/kg instead of 30, {upright} stay upright" in page
    assert all(row["race"]["not_stopped"] == 10 for row in softer)
    ahead = paces["30 W/kg, lead 2.5 m/s"]
    told = (
        f"{ahead['randomized']['upright']}, with a median of {ahead['randomized']['held_median_m_s']:.2f} m/s"
    )
    assert told in page and ahead["race"]["failed"] == ["pad deflection"]


def test_the_page_tells_what_other_clocks_cost(flowing):
    found = json.loads((ROOT / "results/sprint/clock.json").read_text(encoding="utf-8"))
    assert found["sha256"] == hashlib.sha256(shipped_policy("sprint").read_bytes()).hexdigest()
    page, slow = flowing("docs/results.md"), found["at_48_Hz"]["trials"]
    own, slower, quicker, jittered = found["clock_check"]["clocks"]
    cost, jitter = (100 * (1 - row["held_speed_m_s"] / own["held_speed_m_s"]) for row in (quicker, jittered))
    assert f"52 Hz costs it {cost:.1f} % there, periods that vary by 10 % {jitter:.1f} %" in page
    held = sum(row["held_speed_m_s"] for row in slow) / len(slow)
    assert f"48 Hz costs it **{100 * (1 - held / own['held_speed_m_s']):.1f} %**" in page
    moving = [row["speed_in_the_last_second_m_s"] for row in slow]
    assert f"all move at {min(moving):.1f} to {max(moving):.1f} m/s then" in page
    assert slower["completed"] == 0 and min(moving) > AuditThresholds().rest_speed
    assert len(slow) == own["completed"] == quicker["completed"] == 10 and not own["locked"]


def test_the_page_tells_what_the_recipe_gives_another_robot(flowing):
    found = looked_at("eleventh")
    dog = found["other_robot"]["go1"]
    told = f"give {dog['held_raw_m_s']:.2f} m/s asked for {dog['command_m_s']}"
    assert told in flowing("docs/robot.md") and dog["failed"] == ["foot force"]


def lever_row(words, seeds, chosen):
    """A row of the page's table from the recorded trials, up to the last column."""
    trials = [seeds[seed]["trials"] for seed in chosen]
    cells = (
        [f"{speed:.2f}" if (speed := each["12.0"].get("held_m_s")) else "falls" for each in trials],
        [f"{each['10.0']['cost_of_transport']:.2f}" for each in trials],
        [f"{each['12.0']['foot_force_body_weights']:.1f}" for each in trials],
        [f"{each['12.0']['gear_torque_peak']:.1f}" for each in trials],
    )
    return f"| {words} | " + " | ".join(", ".join(cell) for cell in cells) + " |"


def mean_fastest(seeds):
    return sum(row["fastest_in_training_m_s"] for row in seeds.values()) / len(seeds)


def test_the_pages_tell_how_fast_the_calibrated_policy_is_and_what_it_estimates(flowing):
    found = json.loads((ROOT / "results/sprint/calibration.json").read_text(encoding="utf-8"))
    assert found["sha256"] == hashlib.sha256(shipped_policy("sprint").read_bytes()).hexdigest()
    held, estimate = (found["ladder"][f"largest_{name}_error_m_s"] for name in ("speed", "estimate"))
    page, deployment = flowing("docs/results.md"), flowing("docs/deployment.md")
    assert f"| held speed | {held['before']:.2f} m/s | {held['after']:.2f} m/s |" in deployment
    assert f"mean of a hold | {estimate['before']:.2f} m/s | {estimate['after']:.2f} m/s |" in deployment
    ladder = [row for row in found["ladder"]["after"] if row["command_m_s"] <= 12.0]
    errors = [abs(row["speed_error_m_s"]) for row in ladder] + [
        abs(speed - row["command_m_s"])
        for row in found["trials"]
        if row["command_m_s"] <= 12.0
        for speed in row["held_m_s"]
    ]
    assert f"within {max(errors):.1f} m/s, raw and self-paced" in page
    biases = [abs(bias) for row in found["trials"] for bias in row["estimate_bias_m_s"].values()]
    assert f"at most {max(biases):.1f} m/s in every band" in page
    assert {row["self_paced"] for row in found["trials"]} == {False, True}
    assert all(row["completed"] == len(row["held_m_s"]) for row in found["trials"])
