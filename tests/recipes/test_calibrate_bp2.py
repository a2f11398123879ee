"""The surrogate's choice: the rules hold for the calibration kept, and a short search finds its limit."""

import json
from pathlib import Path

import pytest

from sprintlab.robots import load_robot, parameter_table, robot_fingerprint
from sprintlab.speed_limit import SearchSettings, fastest_stride, runner_from_robot

pytest.importorskip("scipy")
ROOT = Path(__file__).parents[2]
FOUND = json.loads((ROOT / "results/speed_limit/bp2.json").read_text(encoding="utf-8"))
CELLS = FOUND["cells"]


@pytest.fixture(scope="module")
def recipe(load_script):
    return load_script("recipes/calibrate_bp2.py")


@pytest.fixture(scope="module")
def editions(load_script):
    return load_script("recipes/bp2_editions.py")


@pytest.fixture(scope="module")
def chosen(recipe):
    return CELLS[recipe.key_of(recipe.EDITIONS["bp2"])]


@pytest.fixture(scope="module")
def spread(recipe):
    """How far four runs of bp2 with other seeds differ: refined limit [m/s], gain of square."""
    runs = [limits for run, limits in FOUND["runs"].items() if run.startswith("bp2 run")]
    assert len(runs) == 4
    refined = [limits["refined"] for limits in runs]
    gains = [limits["square"] / limits["refined"] for limits in runs]
    return max(refined) - min(refined), max(gains) - min(gains)


def with_room(recipe, cell, spread):
    """Whether a cell meets every rule by more than runs differ."""
    refined, simplified, square = (cell["limits"][model]["speed"] for model in recipe.MODELS)
    met = all(recipe.rules(cell).values()) and simplified / refined > 1.02 + spread[1]
    return met and refined > 13.2 + spread[0] and square / refined > 1.09 + spread[1]


def test_every_cell_and_run_of_the_map_was_searched_with_eight_starts(recipe):
    assert set(CELLS) == {recipe.key_of(choice) for choice in recipe.grid()}
    assert set(FOUND["runs"]) == set(recipe.isolated())
    for cell in CELLS.values():
        assert cell["starts"] >= 8 and set(cell["without"]) == {"hip", "knee"}
        assert all(len(cell["limits"][model]["found"]) == cell["starts"] for model in recipe.MODELS)


def test_the_choice_is_the_smallest_motor_that_meets_every_rule(recipe, chosen):
    assert all(recipe.rules(chosen).values())
    met = [recipe.choice_of(key).stack for key, cell in CELLS.items() if all(recipe.rules(cell).values())]
    assert recipe.EDITIONS["bp2"].stack == min(met) > min(recipe.KNEE_GEARS)


def test_the_page_says_how_closely_the_choice_meets_the_rules(recipe, chosen, spread):
    page = (ROOT / "docs/speed-limit.md").read_text(encoding="utf-8")
    refined, _, square = (chosen["limits"][model]["speed"] for model in recipe.MODELS)
    assert f"by {refined - 13.2:.2f} m/s and {100 * (square / refined - 1.09):.1f} percentage points" in page
    assert f"by {spread[0]:.2f} m/s and {100 * spread[1]:.1f} percentage points" in page


def test_hips_stop_it_and_knees_do_not(chosen):
    refined = chosen["limits"]["refined"]["speed"]
    assert chosen["without"]["hip"] > 1.1 * refined
    assert chosen["without"]["knee"] < 1.01 * refined


def test_the_page_says_which_smaller_motors_meet_the_rules(recipe, spread):
    page = (ROOT / "docs/speed-limit.md").read_text(encoding="utf-8")
    met = [recipe.choice_of(key).stack for key, cell in CELLS.items() if all(recipe.rules(cell).values())]
    room = [recipe.choice_of(key).stack for key, cell in CELLS.items() if with_room(recipe, cell, spread)]
    assert f"hold down to stack {min(met):g}" in page
    assert f"by more than runs differ down to stack {min(room):g}" in page
    assert f"{len(CELLS)} cells" in page


def test_the_page_prints_what_the_map_holds(recipe, chosen):
    page = (ROOT / "docs/speed-limit.md").read_text(encoding="utf-8")
    refined, simplified, square = (chosen["limits"][model]["speed"] for model in recipe.MODELS)
    assert f"{refined:.2f} m/s" in page
    assert f"+{100 * (simplified / refined - 1):.1f} %, +{100 * (square / refined - 1):.1f} %" in page
    assert all(f"{chosen['without'][joint]:.1f}" in page for joint in ("hip", "knee"))
    for name in recipe.EDITIONS:
        runs = [limits["refined"] for run, limits in FOUND["runs"].items() if run.split()[0] == name]
        assert f"| `{name}` | {min(runs):.2f} to {max(runs):.2f} |" in page


@pytest.mark.parametrize("model", ["refined", "square"])
def test_a_rule_that_is_broken_is_seen(recipe, chosen, model):
    broken = json.loads(json.dumps(chosen))
    broken["limits"][model]["speed"] *= 0.98 if model == "refined" else 0.95
    assert not all(recipe.rules(broken).values())


def test_a_short_search_finds_the_limit_again(chosen):
    found = fastest_stride(
        runner_from_robot(load_robot("bp2")),
        SearchSettings(starts=2, seed=5, max_stride=5.5, min_duty=0.12),
    )
    assert found.speed == pytest.approx(chosen["limits"]["refined"]["speed"], rel=0.03)
    assert 1.0 / found.parameters[0] <= 5.5 + 1e-6 and found.parameters[1] >= 0.12 - 1e-6


def test_a_killed_walk_goes_on_with_what_is_missing(recipe, tmp_path):
    cell, log = "1.4/8.25/7/800/1", recipe.Log(tmp_path)
    jobs = list(recipe.random_jobs([cell], 2))
    assert len(jobs) == 6 and len({job.identity for job in jobs}) == 6
    for job in jobs[:3]:
        log.add(recipe.search(job))
    with log.path.open("a") as file:
        file.write('{"job":["1.4/8.25/7/800/1","square","rand')  # a kill in the middle of a line
    again = recipe.Log(tmp_path)
    assert [job.identity in again.done for job in jobs] == [True] * 3 + [False] * 3
    found = again.limits()[cell]
    assert all(speed > 10.0 for speed, _ in found.values())
    near = {job.model: job.near for job in recipe.known_jobs([cell], again, 0)}
    assert near["square"] == tuple(found[model] for model in recipe.MODELS)
    content = recipe.document(again)
    assert content["cells"][cell]["starts"] == 1
    recipe.write(tmp_path / "bp2.json", content)
    assert json.loads((tmp_path / "bp2.json").read_text()) == json.loads(json.dumps(content))


def test_known_strides_make_a_limit_no_lower(recipe):
    cell = CELLS["1.4/8.25/7/800/1"]["limits"]["refined"]
    job = recipe.Job("1.4/8.25/7/800/1", "refined", "known 0", 3, ((cell["speed"], cell["stride"]),))
    assert recipe.search(job)["speed"] > cell["speed"] - 0.02


def test_runs_of_an_edition_share_no_seed(recipe):
    jobs = list(recipe.random_jobs(recipe.isolated(), 8))
    seeds = {job.cell: {other.seed for other in jobs if other.cell == job.cell} for job in jobs}
    one, two = seeds["bp2 run 1"], seeds["bp2 run 2"]
    assert len(one) == len(two) == 8 and not one & two


def test_the_tables_are_what_the_builder_makes_of_the_choices(editions):
    for name, choice in editions.EDITIONS.items():
        table = ROOT / "src/sprintlab/robots" / name / "parameters.toml"
        assert table.read_text(encoding="utf-8") == editions.text_of(name)
        assert robot_fingerprint(load_robot(name)) == robot_fingerprint(
            editions.surrogate_robot(choice, name)
        )


def test_motors_scale_with_the_stack_and_the_total_mass_stays(editions):
    choices = (editions.Surrogate(stack=stack, hip_gear=8, knee_gear=7) for stack in (1, 2))
    small, large = (editions.surrogate_robot(choice) for choice in choices)
    assert large.total_mass == small.total_mass == 36.5
    gained = large.mechanics.thigh.mass - small.mechanics.thigh.mass
    assert gained == pytest.approx(editions.motor_mass(2) - editions.motor_mass(1), abs=1e-3)
    assert large.motors.rotor_inertia[1] == pytest.approx(2 * small.motors.rotor_inertia[1], rel=1e-3)
    assert large.motors.rotor_inertia[0] == small.motors.rotor_inertia[0]


def test_the_ends_lie_on_both_sides_of_the_nominal_robot(editions):
    rows = {name: {row.quantity: row.value for row in parameter_table(name)} for name in editions.EDITIONS}
    for quantity in ("motor.hip_knee.peak_torque", "motor.gear_efficiency"):
        assert rows["bp2-weak"][quantity] < rows["bp2"][quantity] < rows["bp2-strong"][quantity]
    for quantity in ("motor.hip_knee.stator_resistance", "shank.mass", "motor.hip.gear_ratio"):
        assert rows["bp2-weak"][quantity] > rows["bp2"][quantity] > rows["bp2-strong"][quantity]
