"""The paper's study: plan, trainings, records, verdicts and the page."""

import hashlib
import math
import shutil
from dataclasses import replace

import pytest
from studies.paper.__main__ import main
from studies.paper.evaluate import Evaluate, find_policies, wanted_places, with_the_audits_top
from studies.paper.plan import Training, study_trainings
from studies.paper.record import (
    RESULTS,
    Command,
    Run,
    best_half,
    median_run,
    read_run,
    read_runs,
    write_run,
)
from studies.paper.statistics import Interval
from studies.paper.verdicts import CLAIMS, judge, verdict

from sprintlab.core.errors import SprintlabError
from sprintlab.evaluation.protocol import ProtocolSettings


def command(speed, *, upright=10, completed=10, held=None, failed=0):
    held = speed if held is None else held
    return Command(
        speed=speed, trials=10, upright=upright, completed=completed, held=held, audit_failed=failed
    )


def run(method="acs", seed=0, commands=(), preset="sprintlab", places=None):
    return Run(
        method=method, preset=preset, seed=seed, command_line="", environment_steps=0, policy_sha256="",
        date="2026-11-28", versions={}, places={"bp2": tuple(commands), **(places or {})}, fastest=None,
    )  # fmt: skip


def seeds_of(method, speed, count=10, preset="sprintlab"):
    """Runs whose speeds rise by 1 cm/s from seed to seed."""
    return [run(method, seed, [command(speed + 0.01 * seed)], preset) for seed in range(count)]


def by_method(*groups):
    return {(group[0].preset, group[0].method): group for group in groups}


@pytest.fixture
def small_plan(monkeypatch):
    monkeypatch.setattr("studies.paper.plan.PAPER_TABLE", {"baseline": None})
    monkeypatch.setattr("studies.paper.plan.OTHERS", ())


def test_the_speed_within_the_audit_is_that_of_upright_trials_that_pass_it():
    speeds = [command(8.0), command(10.0, failed=1), command(9.0), command(12.0, upright=9)]
    assert run(commands=speeds).audited() == 9.0
    assert run(commands=[command(8.0, failed=2)]).audited() == 0.0


def test_the_grid_is_walked_above_the_fastest_command_that_passes_the_audit(monkeypatch):
    monkeypatch.setattr("studies.paper.evaluate.run_speed", lambda pool, speed, **settings: speed)
    monkeypatch.setattr(
        "studies.paper.evaluate.command_record", lambda speed: command(speed, failed=int(speed > 3.5))
    )
    settings = ProtocolSettings(grid=0.5, top=6.0)
    tried = (command(1.0), command(3.0), command(5.0, failed=2))
    found = with_the_audits_top(tried, None, settings)
    assert [one.speed for one in found] == [1.0, 3.0, 3.5, 4.0, 5.0]
    above = with_the_audits_top(tried[2:], None, replace(settings, first_step=1.0))
    assert [one.speed for one in above] == [3.0, 3.5, 4.0, 5.0]
    assert with_the_audits_top(tried[2:], None, replace(settings, start=5.0)) == tried[2:]


def test_running_and_stopping_are_two_speeds():
    speeds = [command(2.0), command(8.0, completed=3), command(11.0, completed=9), command(12.0, upright=8)]
    found = run(commands=speeds)
    assert (found.running(), found.stopping()) == (11.0, 2.0)
    assert run(commands=[command(1.0, held=math.nan)]).running() == 0.0
    assert math.isnan(found.running("drake"))


def test_the_median_is_the_slower_of_two_and_the_best_half_is_rounded_up():
    speeds = (9.0, 12.0, 3.0, 11.0, 10.0)
    group = [run(seed=seed, commands=[command(speed)]) for seed, speed in enumerate(speeds)]
    assert median_run(group).seed == 4 and median_run(group[:4]).seed == 0 and median_run([]) is None
    assert median_run(group, lambda each: each.seed != 4).seed == 0
    assert [each.seed for each in best_half(group, lambda _: True)] == [1, 3, 4]
    assert [each.seed for each in best_half(group, lambda each: each.seed != 3)] == [1, 4, 0]


@pytest.mark.parametrize(
    ("gain", "faster", "expected"),
    [
        ((0.5, 0.3, 0.8), (0.9, 0.7, 1.0), "confirmed"),
        ((-0.5, -0.8, -0.3), (0.1, 0.0, 0.3), "refuted"),
        ((0.1, -0.1, 0.2), (0.7, 0.6, 0.9), "equal within 0.2 m/s"),
        ((0.5, -0.3, 0.8), (0.6, 0.4, 1.0), "open"),
        ((0.5, math.nan, math.nan), (1.0, math.nan, math.nan), "open"),
        ((math.nan,) * 3, (math.nan,) * 3, "not yet run"),
    ],
)
def test_a_verdict_needs_its_interval(gain, faster, expected):
    intervals = (Interval(center=center, low=low, high=high) for center, low, high in (gain, faster))
    assert verdict(*intervals) == expected


def test_a_claim_is_judged_at_each_place_by_the_policies_that_ran_there():
    ours, theirs = seeds_of("acs", 12.0), seeds_of("simplified-dc", 11.0)
    for group in (ours, theirs):  # in Drake the slower half would turn the verdict round
        for each in group[5:]:
            each.places["drake"] = (command(10.0 if each.method == "acs" else 9.0),)
    runs = by_method(ours, theirs)
    assert judge(runs, CLAIMS[0], "sprintlab").said == "confirmed"
    assert judge(runs, CLAIMS[0], "sprintlab", "drake").seeds == (5, 5)
    assert judge(runs, CLAIMS[0], "sprintlab", "bp2-weak").said == "not yet run"
    assert judge(runs, CLAIMS[0], "paper").said == "not yet run"
    few = by_method(ours, theirs[:4])
    assert judge(few, CLAIMS[0], "sprintlab").said == "too few seeds"


def test_the_committed_page_is_written_from_the_committed_records(tmp_path):
    page = tmp_path / "docs" / "study.md"
    main(["page", "--output", str(page), "--figure", str(tmp_path / "docs" / "figures" / "study.png")])
    committed = RESULTS.parents[2] / "docs" / "study.md"
    assert page.read_text(encoding="utf-8") == committed.read_text(encoding="utf-8")


def test_the_plan_has_ten_seeds_of_the_six_methods_with_both_rewards_and_more_for_an_open_pair():
    trainings = study_trainings({})
    assert sum(each.method == "acs" for each in trainings) == 20 and len(set(trainings)) == len(trainings)
    mixed = [run("simplified-dc", seed, [command(11.0 + 2.1 * (seed % 2))]) for seed in range(10)]
    more = set(study_trainings(by_method(seeds_of("acs", 12.0), mixed))) - set(trainings)
    assert {each.method for each in more} == {"acs", "simplified-dc"} and len(more) == 20
    clear = by_method(seeds_of("acs", 12.0), seeds_of("simplified-dc", 11.0))
    assert len(study_trainings(clear)) == len(trainings)


@pytest.mark.usefixtures("small_plan")
def test_trainings_go_on_before_new_ones_begin_and_end_with_the_time(monkeypatch, tmp_path, capsys):
    begun = Training(preset="paper", method="baseline", seed=7).swept(tmp_path, 5, 8)
    begun.folder.mkdir(parents=True)
    (begun.folder / "checkpoint.pt").touch()
    seen = {}

    def train_all(runs, devices, retries, watch):
        seen.update(runs=runs, devices=devices)
        (runs[0].folder / "policy.onnx").touch()
        while True:
            watch({run.name: "finished" if run.finished else "waiting" for run in runs})

    monkeypatch.setattr("studies.paper.plan.train_all", train_all)
    words = ["train", str(tmp_path), "--device", "cpu", "--parallel", "2", "--iterations", "5"]
    words += ["--environments", "8"]
    assert main([*words, "--minutes", "0.001", "--results", str(tmp_path / "none")]) == 0
    assert seen["devices"] == ["cpu", "cpu"] and seen["runs"][0].folder == begun.folder
    assert len({run.name for run in seen["runs"]}) == len(seen["runs"])
    assert "--iterations 5" in seen["runs"][1].command and "1 of " in capsys.readouterr().out


def test_a_damaged_record_is_refused(tmp_path):
    path = write_run(tmp_path, run())
    assert read_runs(tmp_path) == {("sprintlab", "acs"): [run()]}
    path.write_text("{}")
    with pytest.raises(SprintlabError, match="not a record of the study"):
        read_run(path)


@pytest.mark.usefixtures("short_trials")
def test_a_policy_runs_once_at_each_place(policy, tmp_path, monkeypatch):
    folder = tmp_path / "runs" / "sprintlab" / "acs" / "seed-4"
    folder.mkdir(parents=True)
    shutil.copy(policy, folder / "policy.onnx")
    words = ["evaluate", str(tmp_path / "runs"), "--results", str(tmp_path / "results"), "--workers", "1"]
    words += ["--trials", "1", "--start", "0.5", "--top", "0.5", "--places"]
    monkeypatch.setattr("studies.paper.evaluate.COMPARED", {"test"})
    assert main([*words, "bp2"]) == 0
    assert main([*words, "bp2", "bp2-weak"]) == 0
    ((found,),) = read_runs(tmp_path / "results").values()
    assert (found.method, found.seed) == ("test", 3)  # of the contract
    assert [len(found.places[place]) for place in ("bp2", "bp2-weak")] == [1, 1]
    monkeypatch.setattr("studies.paper.evaluate.run_protocol_near", lambda *_, **__: pytest.fail("run again"))
    assert main([*words, "bp2", "bp2-weak"]) == 0


def test_an_edition_is_searched_from_below_the_nominal_speed(policy, tmp_path, monkeypatch):
    begun = []
    write_run(tmp_path, run("test", 3, [command(12.0)]))

    def search(policy, place, near, settings, processes):
        begun.append(near)
        return (command(near),)

    monkeypatch.setattr("studies.paper.evaluate.evaluate_elsewhere", search)
    found = Evaluate(results=tmp_path)._evaluated(policy, "sprintlab", "bp2-weak", None)
    assert begun == [8.0] and found.running("bp2-weak") == 8.0


def test_five_seeds_run_on_the_other_editions_and_the_best_half_in_drake():
    group = seeds_of("acs", 12.0)  # the later seeds are the faster ones
    kept = [each.policy_sha256 for each in group]
    assert wanted_places(group[0], group, kept) == ["bp2-weak", "bp2-strong"]
    for each in group[:5]:
        each.places["bp2-weak"] = ()
    assert wanted_places(group[4], group, kept) == ["bp2-strong"]
    assert wanted_places(group[5], group, kept) == ["bp2-strong", "drake"]
    others = seeds_of("rlvrl", 12.0)
    assert wanted_places(others[9], others, kept) == []


def test_a_policy_that_a_training_finishes_meanwhile_is_evaluated(policy, tmp_path, monkeypatch):
    monkeypatch.setattr("studies.paper.evaluate.LOOK_AGAIN", 0.01)
    place = tmp_path / "runs" / "sprintlab" / "acs" / "seed-4" / "policy.onnx"
    begun, looks = [], iter(range(1000))

    def missing(self):
        if next(looks) == 2:
            place.parent.mkdir(parents=True)
            shutil.copy(policy, place)
        return [(path, preset, "bp2") for path, preset in find_policies(tmp_path / "runs") if not begun]

    def evaluated(self, *task):
        begun.append(task[1])
        return place

    monkeypatch.setattr(Evaluate, "_missing", missing)
    monkeypatch.setattr(Evaluate, "_evaluate", evaluated)
    assert Evaluate(runs=tmp_path / "runs", results=tmp_path, minutes=0.005, workers=1).run() == 0
    assert begun == [place]
    with pytest.raises(SprintlabError, match="holds no runs"):
        Evaluate(runs=tmp_path / "none").run()


def test_the_committed_medians_are_the_policies_of_their_records_and_all_is_small():
    for (preset, method), group in read_runs(RESULTS).items():
        median = RESULTS / preset / method / "median.onnx"
        if median.exists():
            digest = hashlib.sha256(median.read_bytes()).hexdigest()
            (kept,) = (run for run in group if run.policy_sha256 == digest)
            assert kept.running() == pytest.approx(median_run(group).running(), abs=0.1)
    assert sum(path.stat().st_size for path in RESULTS.rglob("*") if path.is_file()) <= 8e6
