"""Training speeds and costs in the pages are those of the committed measurements."""

import json
from pathlib import Path
from statistics import median

import pytest

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "results" / "throughput"
ENVIRONMENTS = (4096, 8192)
MEASUREMENTS = {
    "physics alone": "bare_physics",
    "physics with the motor law": "physics",
    "whole step": "whole_step",
    "with PPO (ours: and estimator)": "ppo",
}
SHARES = {
    "whole step / physics with the motor law": ("whole_step", "physics"),
    "whole step / physics alone": ("whole_step", "bare_physics"),
    "with PPO and estimator / physics with the motor law": ("ppo", "physics"),
    "with PPO and estimator / physics alone": ("ppo", "bare_physics"),
}


def result(name):
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))


def page(name):
    return (ROOT / name).read_text(encoding="utf-8")


def row(*cells):
    return "|" + "|".join(f" {cell} " if cell else " " for cell in cells) + "|"


def speed(environments, part, measurement):
    return result(f"h200-{environments}")["parts"][part][measurement]["median_steps_per_second"]


@pytest.mark.parametrize("environments", ENVIRONMENTS)
@pytest.mark.parametrize(("shown", "measurement"), MEASUREMENTS.items())
def test_throughput_is_the_measured_one(environments, shown, measurement):
    parts = result(f"h200-{environments}")["parts"]
    cells, rates = [str(environments), shown], []
    for name in ("ours-4x5", "mjlab"):
        values = parts[name].get(measurement)
        if values is None:  # mjlab's actuators were not timed apart
            cells += ["", ""]
            continue
        rates.append(values["median_steps_per_second"])
        cells += [f"{rates[-1]:,.0f}", f"{values['median_milliseconds_per_step']:.3f}"]
    cells.append(f"{rates[0] / rates[1]:.1f}" if len(rates) == 2 else "")
    assert row(*cells) in page("docs/training-engine.md")


@pytest.mark.parametrize(("shown", "pair"), SHARES.items())
def test_shares_of_physics_are_the_measured_ones(shown, pair):
    whole, base = pair
    rates = [speed(count, "ours-4x5", whole) / speed(count, "ours-4x5", base) for count in ENVIRONMENTS]
    assert row(shown, *(f"{100 * rate:.1f} %" for rate in rates)) in page("docs/training-engine.md")


@pytest.mark.parametrize("environments", ENVIRONMENTS)
def test_ratios_in_the_files_follow_from_their_rates(environments):
    for name, value in result(f"h200-{environments}")["ratios"].items():
        parts, measurement = name.removesuffix(", steps per second").split(": ")
        if " / mjlab" in parts:
            ours = speed(environments, parts.removesuffix(" / mjlab"), measurement)
            expected = ours / speed(environments, "mjlab", measurement)
        else:
            whole, base = measurement.split(" / ")
            expected = speed(environments, parts, whole) / speed(environments, parts, base)
        assert value == pytest.approx(expected)


def test_readme_names_the_measured_rates(flowing):
    whole, ppo = speed(8192, "ours-4x5", "whole_step"), speed(8192, "ours-4x5", "ppo")
    alone, theirs = speed(8192, "ours-4x5", "bare_physics"), speed(8192, "mjlab", "ppo")
    text = flowing("README.md")
    assert f"{whole / 1e6:.2f} million environment steps per second ({100 * whole / alone:.1f} % of" in text
    assert f"{ppo / 1e6:.2f} million with PPO and the estimator, {ppo / theirs:.1f} times mjlab's" in text


def test_scaling_is_the_measured_one(flowing):
    rows = result("scaling")["rows"]
    alone = next(case["steps_per_second"] for case in rows if case["processes"] == 1)
    assert {(case["kind"], case["processes"]) for case in rows} == {
        *(("weak", count) for count in (1, 2, 4)),
        *(("strong", count) for count in (2, 4)),
    }
    for case in rows:
        count, each, rate = (case[name] for name in ("processes", "environments_each", "steps_per_second"))
        assert count * each == (8192 if case["kind"] == "strong" else 8192 * count)
        cells = (case["kind"], f"{count}", f"{each}", f"{rate:,.0f}", f"{100 * rate / alone / count:.0f} %")
        assert row(*cells) in page("docs/training-engine.md")
    few = next(case for case in rows if case["environments_each"] == 2048)
    times = [1e3 * count / rate for count, rate in ((8192, few["steps_per_second"]), (8192, alone))]
    assert f"of theirs takes {times[0]:.1f} ms" in flowing("docs/training-engine.md")
    assert f"one of 8192 takes {times[1]:.1f} ms" in flowing("docs/training-engine.md")


def test_trainings_ran_as_fast_as_the_pages_say(flowing):
    trainings = result("trainings")["trainings"]
    assert len(trainings) == 2
    for training in trainings:
        rate = training["environment_steps"] / training["seconds"]
        assert training["steps_per_second"] == pytest.approx(rate)
        assert f"{rate / 1e6:.2f} million steps per second for each" in flowing("docs/training-engine.md")


def test_readme_names_the_rate_of_whole_trainings(flowing):
    """Of the first ones on the present plant, two on each GPU: the median."""
    runs = json.loads((ROOT / "results/first-looks/trainings.json").read_text(encoding="utf-8"))["policies"]
    rate = median(2.0 * run["environment_steps"] / run["seconds_at_half_a_gpu"] for run in runs.values())
    assert f"two on a GPU, with twice the physics steps, do {rate / 1e6:.2f} million" in flowing("README.md")


def test_profile_is_the_measured_one():
    phases = result("profile")["phases"]
    whole = sum(phase["microseconds"] for phase in phases.values())
    for name, phase in phases.items():
        time, busy = phase["microseconds"], phase["busy_microseconds"]
        kinds = ", ".join(f"{kind} {spent:.0f}" for kind, spent in phase["kinds"].items())
        share = f"{100 * time / whole:.1f} %"
        cells = (name, f"{time:.0f}", share, f"{busy:.0f}", f"{phase['kernels']:.0f}", kinds)
        assert row(*cells) in page("docs/training-engine.md")


def test_what_the_profile_says_is_in_it(flowing):
    phases, text = result("profile")["phases"], flowing("docs/training-engine.md")
    physics, update = phases["physics"], phases["update"]
    shares = [
        100 * physics["kinds"][kind] / physics["busy_microseconds"] for kind in ("MuJoCo Warp", "motor law")
    ]
    assert f"{shares[0]:.0f} % are MuJoCo Warp's own; the motor law is {shares[1]:.1f} %" in text
    matrices = [
        kernel for kernel in update["largest"] if "gemm" in kernel["name"] or "nvjet" in kernel["name"]
    ]
    slow = [kernel for kernel in matrices if "cutlass_75" in kernel["name"] and "align1" in kernel["name"]]
    assert len(slow) == 3 and matrices[0] is slow[0]
    assert f"they take {sum(kernel['microseconds'] for kernel in slow):.0f} µs" in text
    unknown = [kernel for kernel in matrices if kernel["kind"] == "other"]
    known, all_of_them = sum(kernel["microseconds"] for kernel in unknown), update["kinds"]["other"]
    assert f"at least {known:.0f} of its {all_of_them:.0f} µs" in text


def test_motor_law_costs_what_the_page_says(flowing):
    measured, text = result("motor_law"), page("docs/motor-law.md")
    warp, numpy = measured["warp"], measured["numpy"]
    assert f"physics step itself ({1e6 * warp['physics_substep_s']:.0f} µs)" in flowing("docs/motor-law.md")
    assert f"{numpy['points']:,} points in NumPy" in text
    for name, seconds in warp["law_s"].items():
        share = warp["share_of_substep"][name]
        assert share == pytest.approx(seconds / warp["physics_substep_s"])
        alone = f"{1e3 * numpy['seconds'][name]:.0f} ms" if name in numpy["seconds"] else ""
        assert row(name, f"{1e6 * seconds:.1f} µs", f"{100 * share:.1f} %", alone) in text


def test_committed_results_hold_no_paths_of_a_machine():
    for path in RESULTS.glob("*.json"):
        text = path.read_text(encoding="utf-8")
        assert not any(f"{folder}/" in text for folder in ("/tmp", "/opt", "/home", "/root")), path.name


def test_speed_over_time_is_told_as_measured(flowing):
    (run,) = result("speed_over_time")["runs"]
    text = page("docs/training-engine.md")
    for point in run["milestones"]:
        time = (f"{point['seconds']:.0f}", point["iterations"], f"{point['environment_steps'] / 1e6:.0f}")
        speeds = (
            f"{point['top_speed']:g}",
            f"{point['held_speed']:.2f}",
            f"{point['completed_top_speed']:g}",
        )
        assert row(*time, *speeds) in text
    assert run["facts"]["device"] in flowing("docs/training-engine.md")
    fastest = max(point["held_speed"] for point in run["milestones"])
    assert fastest == run["milestones"][-1]["held_speed"]
    assert min(p["seconds"] for p in run["milestones"] if p["held_speed"] >= 10.0) < 120.0
