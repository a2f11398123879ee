"""What the pages tell of the six methods is what the committed evaluations and curves say."""

import csv
import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from sprintlab.control import load_policy, shipped_policy
from sprintlab.control.policy import METHOD_POLICIES
from sprintlab.evaluation.ablation.paper import PAPER_TABLE
from sprintlab.evaluation.ablation.runs import committed_records, find_runs

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "results"
RUNS = find_runs(RESULTS / "methods")
RECORDS = {(record.method, record.seed): record for record in committed_records(RUNS)}
LONGER_RUNS = find_runs(RESULTS / "longer")
LONGER = {(record.method, record.seed): record for record in committed_records(LONGER_RUNS)}
SHIPPED = {"sprint": ("sprint", 2), "sprint-fast": ("fixed-acceleration", 0)}
"""Policies that come with the package, and the longer runs that they are of."""
SECTIONS = {
    "The default policy: `sprint`": "longer/sprint/seed-2",
    "The fast one: `sprint-fast`": "longer/fixed-acceleration/seed-0",
}


def evaluation(folder):
    return json.loads((RESULTS / folder / "evaluation.json").read_text(encoding="utf-8"))


def rows(section, label):
    """Cells of the rows of a section of the results page that begin with ``label``."""
    page = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    lines = page.split(f"\n## {section}\n")[1].split("\n## ")[0].splitlines()
    found = [line for line in lines if line.startswith(f"| {label} |")]
    return [[cell.strip() for cell in line.strip("|").split("|")[1:]] for line in found]


def test_every_method_has_three_seeds_of_one_budget():
    assert {method for method, _ in RECORDS} == set(PAPER_TABLE)
    assert len(RECORDS) == len(RUNS) == 3 * len(PAPER_TABLE)
    assert {record.training["environment_steps"] for record in RECORDS.values()} == {"104857600"}


@pytest.mark.parametrize("method", PAPER_TABLE)
def test_the_best_seed_is_in_the_package(method):
    of_method = [record for record in RECORDS.values() if record.method == method]
    best = max(of_method, key=lambda record: (record.honest, np.nan_to_num(record.raw.max_velocity)))
    shipped = METHOD_POLICIES / f"{method}.onnx"
    assert hashlib.sha256(shipped.read_bytes()).hexdigest() == best.policy_sha256
    training = load_policy(shipped).contract.training
    assert (training.method, training.seed) == (method, best.seed)
    assert training.command_line == best.training["command_line"]


@pytest.mark.parametrize("method", PAPER_TABLE)
def test_it_was_trained_as_the_page_says(method, flowing):
    pytest.importorskip("mujoco_warp")
    from sprintlab.training.run import TrainOptions
    from sprintlab.training.settings import PpoSettings, StageSettings, TrainingSettings

    training = load_policy(METHOD_POLICIES / f"{method}.onnx").contract.training
    settings = TrainingSettings(
        ppo=PpoSettings(precision="bfloat16"), stages=StageSettings(steady_iteration=1350)
    )
    options = TrainOptions(method=method, seed=training.seed, settings=settings)
    assert options.full_settings().digest() == training.config_hash
    assert training.iterations == 1600
    words = "--iterations 1600 --settings.stages.steady-iteration 1350 --settings.ppo.precision bfloat16"
    assert f"sprintlab train sprint --seed 0 {words}" in flowing("docs/results.md")
    written = json.loads(
        (RESULTS / "methods" / method / f"seed-{training.seed}" / "settings.json").read_text()
    )
    assert written == json.loads(
        json.dumps({"config_hash": training.config_hash, **options.full_settings().as_dict()})
    )


def ends_of_the_second_stage(runs, method, steady):
    """The last row of each run's curve before its steady stage."""
    ends = []
    for run in (run for run in runs if run.method == method):
        with (run.folder / "curve.csv").open(newline="") as file:
            ends.append([row for row in csv.DictReader(file) if int(row["iteration"]) <= steady][-1])
    return ends


@pytest.mark.parametrize("method", PAPER_TABLE)
def test_the_table_of_the_trainings_is_of_their_curves(method):
    ends = ends_of_the_second_stage(RUNS, method, 1350)
    fastest, speed, error, limit, power = (
        np.array([float(row[name]) for row in ends])
        for name in ("speed_p999", "speed", "command_error", "on_limit", "power")
    )
    assert len(fastest) == 3
    (cells,) = rows("What agrees with the paper, and what does not", f"`{method}`")
    assert cells[:4] == [
        f"{fastest.mean():.1f} ({fastest.min():.1f} to {fastest.max():.1f})",
        f"{speed.mean():.1f}",
        f"{error.mean():.2f}",
        f"{100 * limit.mean():.1f}",
    ]
    assert float(cells[4]) == pytest.approx(power.mean(), rel=0.005)


@pytest.mark.parametrize(("section", "folder"), SECTIONS.items())
@pytest.mark.parametrize(("label", "way"), [("raw", "raw"), ("self-paced", "self_paced")])
def test_speed_by_speed(section, folder, label, way):
    (commands,) = rows(section, "command [m/s]")
    (cells,) = rows(section, f"held, {label} [m/s]")
    tried = {row["top_speed"]: row for row in evaluation(folder)[way]["speeds"]}
    for command, cell in zip(map(float, commands), cells, strict=True):
        row = tried.get(command)
        expected = "not tried" if row is None else f"{row['held_speed']:.2f}" if row["passed"] else "fails"
        assert cell == expected, command
    (deviations,) = rows(section, f"sideways deviation, {label} [m]")
    assert deviations == [f"{tried[float(command)]['lateral_deviation']:.1f}" for command in commands]
    (marks,) = rows(section, f"audit, {label}")
    for command, mark in zip(map(float, commands), marks, strict=True):
        failed = [item["name"] for item in tried[command]["audit"]["items"] if not item["passed"]]
        assert failed == {"clock": ["stride period from policy clock"], "passed": []}[mark], command


@pytest.mark.parametrize("folder", SECTIONS.values())
def test_no_trial_of_a_shipped_policy_s_search_fell(folder):
    told = evaluation(folder)
    assert all(row["falls"] == 0 for way in ("raw", "self_paced") for row in told[way]["speeds"])
    assert all(told[way]["speeds"][-1]["top_speed"] == 16.0 for way in ("raw", "self_paced"))


@pytest.mark.parametrize("name", SHIPPED)
def test_the_shipped_policy_is_of_the_longer_run_that_the_page_names(name):
    sha256 = hashlib.sha256(shipped_policy(name).read_bytes()).hexdigest()
    assert sha256 == LONGER[SHIPPED[name]].policy_sha256


@pytest.mark.parametrize("method", ["no-envelope", "fixed-acceleration", "sprint"])
def test_the_table_of_the_longer_runs_is_of_their_files(method):
    records = [LONGER[method, seed] for seed in range(3)]
    told = [evaluation(f"longer/{method}/seed-{seed}") for seed in range(3)]
    fastest = [float(row["speed_p999"]) for row in ends_of_the_second_stage(LONGER_RUNS, method, 2750)]
    ways = ("raw", "self_paced")
    falls = [
        ", ".join(
            " of ".join(str(sum(row[name] for row in one[way]["speeds"])) for name in ("falls", "trials"))
            for one in told
        )
        for way in ways
    ]
    (cells,) = rows("Twice the budget", f"`{method}`")
    assert cells == [
        f"{np.mean(fastest):.1f} ({min(fastest):.1f} to {max(fastest):.1f})",
        *(", ".join(f"{getattr(one, way).max_velocity:.2f}" for one in records) for way in ways),
        ", ".join(f"{one['sprint']['time']:.2f}" for one in told),
        *falls,
    ]
    assert {record.training["environment_steps"] for record in records} == {"209715200"}


def greatest_loss(clock):
    """Share of the held speed that the worst of a policy's other clocks costs."""
    return 1.0 - min(entry["held_speed"] for entry in clock) / clock[0]["held_speed"]


def test_the_default_policy_s_numbers_stand_in_every_page(flowing):
    told, record = evaluation("longer/sprint/seed-2"), LONGER["sprint", 2]
    page, clock = flowing("docs/results.md"), told["clock"]["entries"]
    assert (
        f"**{record.raw.max_velocity:.2f} m/s** raw and {record.self_paced.max_velocity:.2f} m/s self-paced"
        in page
    )
    most = max(told["raw"]["speeds"], key=lambda row: row["held_speed"])
    held = f"{most['held_speed']:.2f} m/s"
    assert f"the most it holds, raw, is {held} at {most['top_speed']:g} m/s" in page
    times = [told[name]["time"] for name in ("sprint", "sprint_self_paced")]
    assert f"It runs 100 m in {times[0]:.2f} s raw and {times[1]:.2f} s self-paced" in page
    loss = greatest_loss(clock)
    assert f"all 40 trials complete, and the worst costs {100 * loss:.1f} % of the speed" in page
    assert all(entry["completed"] == entry["trials"] == 10 for entry in clock)
    assert f"| {held} |" in flowing("docs/speed-limit.md")


def test_readme_s_table_is_of_the_committed_race():
    race = json.loads((RESULTS / "bp2-sprint" / "result.json").read_text())
    assert race["facts"]["policy SHA-256"] == LONGER["sprint", 2].policy_sha256
    page = (ROOT / "README.md").read_text(encoding="utf-8")
    shown = {
        "held speed (last 2 s of the hold)": "{held_speed_m_s:.2f} m/s",
        "peak speed (0.5 s mean)": "{peak_speed_m_s:.2f} m/s",
        "J": "{J_rad2_s:.1f} rad²/s",
        "cost of transport": "{cost_of_transport:.2f}",
        "mechanical power": "{mechanical_power_W:.0f} W",
        "copper loss": "{copper_power_W:.0f} W",
        "stride frequency": "{stride_frequency_Hz:.2f} Hz",
        "sideways deviation": "{lateral_deviation_m:.1f} m",
        "falls": "{falls} of {trials}",
    }
    for name, form in shown.items():
        assert f"| {name} | {form.format(**race)} | {form.format(**race['self_paced'])} |" in page, name
    times = f"{race['time_100m_s']:.2f} s | {race['time_100m_self_paced_s']:.2f} s"
    assert f"| time over 100 m | {times} |" in page
    assert race["audit"]["passed"]


def test_the_fastest_policy_s_numbers_stand_in_every_page(flowing):
    told, record = evaluation("longer/fixed-acceleration/seed-0"), LONGER["fixed-acceleration", 0]
    most = max(told["raw"]["speeds"], key=lambda row: row["held_speed"])
    held, clock = f"{most['held_speed']:.2f} m/s", told["clock"]["entries"]
    assert f"holds {held} and runs 100 m in {told['sprint']['time']:.2f} s" in flowing("README.md")
    assert f"holds {held} at a command of {most['top_speed']:g} m/s" in flowing("docs/speed-limit.md")
    page = flowing("docs/results.md")
    assert f"**{held}** raw at {most['top_speed']:g} m/s and {record.self_paced.max_velocity:.2f} m/s" in page
    assert f"{told['sprint_self_paced']['time']:.2f} s self-paced" in page
    loss = greatest_loss(clock)
    for text in (page, flowing("README.md")):
        assert f"{100 * loss:.1f} % at most" in text
    complete, trials = (sum(entry[name] for entry in clock) for name in ("completed", "trials"))
    assert f"{complete} of {trials} trials complete" in page


def test_the_policy_beyond_the_speed_limit_is_told_as_it_was(flowing):
    told = evaluation("longer/fixed-acceleration/seed-1")
    fastest, raw = told["self_paced"]["speeds"][-1], told["raw"]["speeds"][-1]
    assert all(item["passed"] for item in fastest["audit"]["items"]) and fastest["falls"] == 0
    assert (raw["top_speed"], raw["falls"]) == (2.0, 2)
    policy = RESULTS / "longer" / "fixed-acceleration" / "seed-1" / "policy.onnx"
    assert hashlib.sha256(policy.read_bytes()).hexdigest() == LONGER["fixed-acceleration", 1].policy_sha256
    held, time = f"{fastest['held_speed']:.2f} m/s", f"{told['sprint_self_paced']['time']:.2f} s"
    assert f"holds {held} self-paced at 16 m/s and runs 100 m in {time}" in flowing("docs/results.md")
    assert f"{held}, self-paced at 16 m/s" in flowing("docs/speed-limit.md")
