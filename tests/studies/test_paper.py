"""The paper's study: plan, records, verdicts and the page."""

import math
import shutil

import pytest
from studies.paper.__main__ import main
from studies.paper.page import CLAIMS, grouped, page_text, verdict
from studies.paper.plan import RESULTS, study_trainings
from studies.paper.record import Command, Run, read_run, read_runs, write_run
from studies.paper.statistics import Interval, difference, improvement

from sprintlab.core.errors import SprintlabError


def command(speed, *, upright=10, completed=10, held=None):
    held = speed if held is None else held
    return Command(speed=speed, trials=10, upright=upright, completed=completed, held=held)


def run(method="acs", seed=0, commands=(), preset="sprintlab"):
    return Run(
        method=method, preset=preset, seed=seed, motor_model="refined", command_line="", environment_steps=0,
        policy_sha256="", robot_fingerprint="", date="2026-11-28", versions={}, commands=tuple(commands),
        fastest=None,
    )  # fmt: skip


def test_running_and_stopping_are_two_speeds():
    found = run(
        commands=[
            command(2.0),
            command(8.0, completed=3),
            command(11.0, completed=9),
            command(12.0, upright=8),
        ]
    )
    assert (
        (found.running, found.stopping) == (11.0, 2.0) and not found.collapsed and not found.ended_at_stopping
    )
    assert run(commands=[command(1.0, held=math.nan)]).running == 0.0


@pytest.mark.parametrize(
    ("gain", "faster", "expected"),
    [
        ((0.5, 0.3, 0.8), (0.9, 0.7, 1.0), "confirmed"),
        ((-0.5, -0.8, -0.3), (0.1, 0.0, 0.3), "refuted"),
        ((0.1, -0.1, 0.2), (0.7, 0.6, 0.9), "equal within 0.2 m/s"),
        ((0.5, -0.3, 0.8), (0.6, 0.4, 1.0), "open"),
        ((0.5, math.nan, math.nan), (1.0, math.nan, math.nan), "open"),
    ],
)
def test_a_verdict_needs_its_interval(gain, faster, expected):
    intervals = (Interval(center=center, low=low, high=high) for center, low, high in (gain, faster))
    assert verdict(*intervals) == expected


def test_every_claim_of_the_page_follows_from_the_records():
    seeds = range(10)
    runs = [run("acs", seed, [command(12.0 + 0.01 * seed)]) for seed in seeds]
    runs += [run("simplified-dc", seed, [command(11.0 + 0.01 * seed)]) for seed in seeds]
    text = page_text(grouped(runs), "figures/study.png")
    assert f"**{CLAIMS[0].question}** Confirmed." in text and "| 1.0 [1.0, 1.0] |" in text
    assert text.count("is not trained yet") == len(CLAIMS) - 1


def test_the_committed_page_is_written_from_the_committed_records(tmp_path):
    page = tmp_path / "docs" / "study.md"
    main(["page", "--output", str(page), "--figure", str(tmp_path / "docs" / "figures" / "study.png")])
    assert page.read_text(encoding="utf-8") == (RESULTS.parents[2] / "docs/study.md").read_text(
        encoding="utf-8"
    )


def test_the_plan_has_ten_seeds_of_the_six_methods_with_both_rewards():
    trainings = study_trainings()
    assert sum(each.method == "acs" for each in trainings) == 20 and len(set(trainings)) == len(trainings)


def test_a_run_that_has_its_record_is_not_missing(capsys, tmp_path):
    main(["plan", "runs/study", "--results", str(tmp_path)])
    before = capsys.readouterr().out
    write_run(tmp_path, run("baseline", 3))
    main(["plan", "runs/study", "--results", str(tmp_path)])
    missing = "sprintlab train bp2 --method baseline --seed 3 --output runs/study/sprintlab/baseline/seed-3\n"
    assert missing in before and missing not in capsys.readouterr().out


def test_a_damaged_record_is_refused(tmp_path):
    path = write_run(tmp_path, run())
    assert read_runs(tmp_path) == [run()]
    path.write_text("{}")
    with pytest.raises(SprintlabError, match="not a record of the study"):
        read_run(path)


@pytest.mark.usefixtures("short_trials")
def test_a_policy_gets_its_record_once(policy, tmp_path, monkeypatch):
    folder = tmp_path / "runs" / "sprintlab" / "acs" / "seed-4"
    folder.mkdir(parents=True)
    shutil.copy(policy, folder / "policy.onnx")
    words = ["evaluate", str(tmp_path / "runs"), "--results", str(tmp_path / "results"), "--workers", "1"]
    words += ["--trials", "1", "--start", "0.5", "--top", "0.5"]
    assert main(words) == 0
    (found,) = read_runs(tmp_path / "results")
    assert (found.method, found.seed) == ("test", 3)  # of the contract
    assert [each.upright for each in found.commands] == [1]
    monkeypatch.setattr("studies.paper.evaluate.evaluate_policy", lambda *_: pytest.fail("evaluated again"))
    assert main(words) == 0


def test_statistics_of_equal_seeds_are_certain():
    assert improvement([2.0, 2.0], [1.0, 1.0]).low == 1.0
    assert difference([2.0, 2.0], [1.0, 1.0]).center == pytest.approx(1.0)
