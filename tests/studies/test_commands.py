"""The study's commands: what they print, write and refuse."""

import json
import os
import shutil
import sys
import types
from pathlib import Path

import pytest
from studies.paper.paper import PAPER_TABLE
from studies.paper.record import read_evaluation

pytestmark = pytest.mark.usefixtures("short_trials")
QUICK = ("--trials", 1, "--start", 0.5, "--top", 0.5, "--workers", 1)


@pytest.fixture(scope="module")
def runs(tmp_path_factory, policy):
    folder = tmp_path_factory.mktemp("methods")
    run = folder / "sprint" / "seed-4"
    run.mkdir(parents=True)
    shutil.copy(policy, run / "policy.onnx")
    return folder


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """One for all tests of this file, so that the policy is simulated once."""
    return tmp_path_factory.mktemp("cache")


def test_a_folder_of_runs_gets_its_table_and_evaluations(call, runs, cache, tmp_path):
    out = tmp_path / "numbers.json"
    outcome = call("table", runs, *QUICK, "--cache", cache, "--out", out)
    assert outcome.status == 0
    for words in ("Table II", "12.4", "collapse", "sprint", "baseline", "1.452"):
        assert words in outcome.out
    record = read_evaluation(runs / "sprint" / "seed-4" / "evaluation.json")
    assert (record.method, record.seed) == ("sprint", 4) and record.raw.speeds[0].falls == 0
    numbers = json.loads(out.read_text())
    assert numbers["methods"]["sprint"]["collapsed"] == 1  # it stands
    assert numbers["methods"]["baseline"]["paper_max_velocity_m_s"] == 9.4
    assert len(numbers["records"]) == 1


def test_json_is_all_that_is_printed_and_recorded_evaluates_nothing(call, runs, cache):
    call("table", runs, *QUICK, "--cache", cache)
    outcome = call("table", runs, "--recorded", "--json")
    assert outcome.status == 0
    assert json.loads(outcome.out)["methods"]["sprint"]["seeds"] == 1


def test_the_page_gets_its_tables(call, runs, cache, tmp_path):
    call("table", runs, *QUICK, "--cache", cache)
    page = tmp_path / "results.md"
    names = ("methods", "details", "seeds", "clock", "estimates")
    page.write_text("\n".join(f"<!-- computed: {name} -->\n<!-- end of {name} -->" for name in names))
    outcome = call("table", runs, "--recorded", "--markdown", page)
    assert outcome.status == 0 and "| method | motor in training |" in page.read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("somewhere", "--recorded", "--train"), "evaluates nothing"),
        (("does-not-exist",), "no folder"),
        (("{runs}", "--trials", 0), "trials"),
        (("{runs}", "--grid", -1), "grid"),
        (("{runs}", "--workers", 0), "workers"),
        (("{runs}", "--markdown", "no-page.md"), "cannot read page no-page.md"),
    ],
)
def test_bad_input_is_one_sentence(call, runs, arguments, words):
    outcome = call("table", *(str(part).format(runs=runs) for part in arguments))
    assert outcome.status == 2 and outcome.out == ""
    assert outcome.err.startswith("studies.paper: ") and words in outcome.err and outcome.err.count("\n") == 1


def no_folder(place: Path, kind: str) -> Path:
    """A name that is no folder: its path."""
    if kind == "pipe":
        os.mkfifo(place)
    elif kind == "loop":
        place.symlink_to(place.name)
    elif kind == "file":
        place.touch()
    return place.with_name("n" * 5000) if kind == "long" else place


@pytest.mark.parametrize("kind", ["pipe", "loop", "file", "missing", "long"])
@pytest.mark.parametrize(
    "command", ["table", "variants", "own-motor", "publish", "plan --results", "page --results"]
)
def test_what_is_no_folder_of_runs_is_told_in_one_sentence(call, tmp_path, command, kind):
    outcome = call(*command.split(), no_folder(tmp_path / "runs", kind))
    assert (outcome.status, outcome.out) == (2, "")
    assert outcome.err.startswith("studies.paper: there is no folder") and outcome.err.count("\n") == 1


@pytest.mark.parametrize("kind", ["pipe", "loop", "file", "long"])
def test_future_runs_may_be_missing_and_may_be_nothing_else(call, tmp_path, kind):
    assert call("plan", tmp_path / "later").status == 0
    outcome = call("plan", no_folder(tmp_path / "runs", kind))
    assert (outcome.status, outcome.out) == (2, "") and outcome.err.count("\n") == 1


@pytest.mark.parametrize("option", ["--out", "--markdown", "--cache"])
@pytest.mark.parametrize("kind", ["pipe", "loop"])
def test_what_cannot_be_written_is_refused_before_any_work(call, runs, tmp_path, option, kind):
    outcome = call("table", runs, option, no_folder(tmp_path / "place", kind), *QUICK)
    assert (outcome.status, outcome.out) == (2, "") and outcome.err.count("\n") == 1
    assert "cannot" in outcome.err


def test_a_folder_without_runs_and_a_damaged_record_are_refused(call, tmp_path):
    assert "seed-<number>" in call("table", tmp_path).err
    run = tmp_path / "sprint" / "seed-0"
    run.mkdir(parents=True)
    (run / "evaluation.json").write_text("{}")
    outcome = call("table", tmp_path, "--recorded")
    assert outcome.status == 2 and "no record of this version" in outcome.err


def test_figures_refuse_an_unknown_policy_and_speed(call, runs, tmp_path):
    outcome = call("figures", "--results", runs, "--policy", "gallop", "--out", tmp_path / "figures")
    assert outcome.status == 2 and "gallop" in outcome.err and not (tmp_path / "figures").exists()
    assert "top_speed" in call("figures", "--top-speed", 0).err
    page = tmp_path / "page.md"
    page.write_text("no marks")
    outcome = call("figures", "--out", tmp_path / "figures", "--markdown", page)
    assert outcome.status == 2 and "computed: figures" in outcome.err and not (tmp_path / "figures").exists()


@pytest.fixture
def trained(monkeypatch, policy):
    """Training and export replaced by what they leave behind; the methods that were trained are kept."""
    seen = []

    def train(options):
        seen.append((options.method, options.seed, options.minutes))
        options.output.mkdir(parents=True)
        (options.output / "checkpoint.pt").write_bytes(b"checkpoint")

    def export(checkpoint, output):
        shutil.copy(policy, output)

    def fake(**names):
        module = types.ModuleType("fake")
        vars(module).update(names)
        return module

    monkeypatch.setattr("sprintlab.api.training.require_training", lambda: None)
    run = fake(TrainOptions=types.SimpleNamespace, train=train)
    monkeypatch.setitem(sys.modules, "sprintlab.training.runs.run", run)
    monkeypatch.setitem(sys.modules, "sprintlab.training.runs.export", fake(export_checkpoint=export))
    return seen


def test_what_is_missing_is_trained_exported_and_evaluated(call, trained, runs, cache, tmp_path):
    folder = tmp_path / "methods"
    shutil.copytree(runs / "sprint" / "seed-4", folder / "sprint" / "seed-0")
    options = ("--train", "--seeds", 1, "--minutes", 3, "--cache", cache, "--json")
    outcome = call("table", folder, *options, *QUICK)
    assert outcome.status == 0
    assert [(method, seed) for method, seed, _ in trained] == [
        (method, 0) for method in PAPER_TABLE if method != "sprint"
    ]
    assert {minutes for *_, minutes in trained} == {3.0}
    methods = json.loads(outcome.out)["methods"]
    assert {name: row["seeds"] for name, row in methods.items()} == dict.fromkeys(PAPER_TABLE, 1)
    call("table", folder, *options, *QUICK)
    assert len(trained) == 5  # nothing is trained twice


def test_training_without_its_packages_is_refused(call, monkeypatch, tmp_path):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    outcome = call("table", tmp_path, "--train")
    assert outcome.status == 2 and "pip install" in outcome.err


def test_a_missing_run_is_not_trained_behind_a_link(call, trained, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "sprint").symlink_to(tmp_path / "elsewhere", target_is_directory=True)
    outcome = call("table", tmp_path / "runs", "--train", "--seeds", 1)
    assert outcome.status == 2 and "is a link" in outcome.err
    assert not any((tmp_path / "elsewhere").iterdir())


def test_a_name_that_is_one_argument_too_many_does_not_speak_to_the_terminal(call):
    outcome = call("table", "\x1b]0;title\x07name")
    assert outcome.status == 2
    assert r"\x1b]0;title\x07" in outcome.err and "\x1b" not in outcome.err
