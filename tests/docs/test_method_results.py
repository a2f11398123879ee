"""What the pages tell of the six methods is what the committed evaluations and curves say."""

import csv
import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from sprintlab.control import load_policy
from sprintlab.control.policy import METHOD_POLICIES
from sprintlab.evaluation.ablation.paper import PAPER_TABLE
from sprintlab.evaluation.ablation.runs import committed_records, find_runs

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "results"
RUNS = find_runs(RESULTS / "methods")
RECORDS = {(record.method, record.seed): record for record in committed_records(RUNS)}
END_OF_SECOND_STAGE = 1348


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
def test_it_was_trained_with_the_defaults_of_its_method(method):
    pytest.importorskip("mujoco_warp")
    from sprintlab.training.run import TrainOptions
    from sprintlab.training.settings import PpoSettings, TrainingSettings

    training = load_policy(METHOD_POLICIES / f"{method}.onnx").contract.training
    settings = TrainingSettings(ppo=PpoSettings(precision="bfloat16"))
    options = TrainOptions(method=method, seed=training.seed, settings=settings)
    assert options.full_settings().digest() == training.config_hash
    assert options.iterations == training.iterations
    written = json.loads(
        (RESULTS / "methods" / method / f"seed-{training.seed}" / "settings.json").read_text()
    )
    assert written == json.loads(
        json.dumps({"config_hash": training.config_hash, **options.full_settings().as_dict()})
    )


@pytest.mark.parametrize("method", PAPER_TABLE)
def test_the_table_of_the_trainings_is_of_their_curves(method):
    ends = []
    for run in (run for run in RUNS if run.method == method):
        with (run.folder / "curve.csv").open(newline="") as file:
            ends += [row for row in csv.DictReader(file) if int(row["iteration"]) == END_OF_SECOND_STAGE]
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


@pytest.mark.parametrize(
    ("section", "folder"),
    [
        ("The default policy: `sprint`", "bp2-sprint"),
        ("The fastest: `methods/fixed-acceleration`", "methods/fixed-acceleration/seed-0"),
    ],
)
@pytest.mark.parametrize(("label", "way"), [("raw", "raw"), ("self-paced", "self_paced")])
def test_speed_by_speed(section, folder, label, way):
    (commands,) = rows(section, "command [m/s]")
    (cells,) = rows(section, f"held, {label} [m/s]")
    tried = {row["top_speed"]: row for row in evaluation(folder)[way]["speeds"]}
    for command, cell in zip(map(float, commands), cells, strict=True):
        row = tried.get(command)
        expected = "not tried" if row is None else f"{row['held_speed']:.2f}" if row["passed"] else "fails"
        assert cell == expected, command
    for found in rows(section, f"sideways deviation, {label} [m]"):
        for command, cell in zip(map(float, commands), found, strict=True):
            row = tried.get(command)
            assert cell == (f"{row['lateral_deviation']:.1f}" if row and row["passed"] else "")


def test_the_fastest_policy_s_numbers_stand_in_every_page(flowing):
    told = evaluation("methods/fixed-acceleration/seed-0")
    record = RECORDS["fixed-acceleration", 0]
    held, clock = f"{record.raw.max_velocity:.2f} m/s", told["clock"]["entries"]
    assert f"holds {held} and runs 100 m in {told['sprint']['time']:.2f} s" in flowing("README.md")
    page = flowing("docs/results.md")
    assert f"**{held}** raw at {told['raw']['speeds'][-2]['top_speed']:g} m/s" in page
    assert f"{told['sprint_self_paced']['time']:.2f} s self-paced" in page
    loss = 1.0 - min(entry["held_speed"] for entry in clock) / clock[0]["held_speed"]
    for text in (page, flowing("README.md")):
        assert f"{100 * loss:.1f} % at most" in text
    complete, trials = (sum(entry[name] for entry in clock) for name in ("completed", "trials"))
    assert f"{complete} of {trials} trials complete" in page
    fastest = max(record.raw.max_velocity for record in RECORDS.values() if record.raw.speeds)
    assert fastest == record.raw.max_velocity
