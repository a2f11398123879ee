"""``evaluate``: the highest speed that a policy completes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from sprintlab.api.drive import DriveOptions
from sprintlab.api.policies import PolicyChoice, RobotChoice, policy_path, trial_pool
from sprintlab.api.results import Drawn, Progress, kept, quantities, records, silent
from sprintlab.core.arguments import checked
from sprintlab.core.checks import check_range
from sprintlab.core.files import atomic_write_json, check_writable_file
from sprintlab.core.json_values import json_ready
from sprintlab.evaluation.audit import audit_trials
from sprintlab.evaluation.clock import ClockCheck, check_clock
from sprintlab.evaluation.estimates import merge_bands
from sprintlab.evaluation.protocol import ProtocolSettings, battery_request, run_protocol
from sprintlab.evaluation.report_text import audit_failure, battery_text
from sprintlab.evaluation.results import ProtocolResult, SpeedResult, supply_numbers

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_KEYS = ("top_speed_command_m_s", "held_speed_m_s", "trials", "falls", "not_stopped")


@checked
def evaluate(
    policy: PolicyChoice,
    *,
    robot: RobotChoice = None,
    trials: int = 10,
    seed: int = 0,
    start: float = 1.0,
    top: float = 16.0,
    grid: float = 0.25,
    every_speed: bool = False,
    clock_check: bool = False,
    drive: DriveOptions = DriveOptions(),
    workers: int | None = None,
    output: Path | str | None = None,
    progress: Progress = silent,
) -> Drawn:
    """Find the highest speed that a policy completes in 9 of 10 seeded trials, raw and self-paced.

    The max velocity is what it holds at the highest command that passes, which may not be its fastest.
    Example: sprintlab evaluate sprint --start 8 --output numbers.json

    Args:
        trials: trials at each speed, each with a seed of its own.
        start: lowest speed of the search [m/s].
        top: highest speed of the search [m/s].
        grid: step between speeds [m/s].
        every_speed: walk the whole grid instead of whole m/s first.
        clock_check: repeat the highest raw command that passed with other rates of the policy, and jitter.
        output: also write the numbers here (JSON).
    """
    if output is not None:
        check_writable_file(output)
    plant, name = drive.plant(), policy_path(policy).stem
    step = first_step(grid, every_speed)
    settings = protocol_settings(trials, seed, start=start, top=top, grid=grid, first_step=step, plant=plant)
    searches, clocks, battery = dict[str, ProtocolResult](), None, None
    with trial_pool(policy, robot, workers) as pool:
        for way in ("raw", "self_paced"):

            def told(speed: SpeedResult, way: str = way) -> None:
                share = (speed.top_speed - start) / max(top - start, 1e-9)
                progress(f"{way.replace('_', '-')}: {speed.top_speed:g} m/s, {speed.falls} falls", share)

            searches[way] = run_protocol(
                pool, self_paced=way == "self_paced", settings=settings, progress=told
            )
        best = searches["raw"].best
        if best is not None and clock_check:
            progress("other policy clocks", None)
            clocks = check_clock(pool, best.top_speed, settings=settings)
        if best is not None and (request := battery_request(best.top_speed, settings)) is not None:
            battery = next(iter(pool.trials([request])))
    numbers: dict[str, Any] = {
        way: {**protocol_numbers(found), "notes": list(plant.remarks)} for way, found in searches.items()
    }
    shown = list(_shown(name, numbers))
    if battery is not None:
        numbers["battery"] = json_ready(supply_numbers(battery))
        shown.append(f"on battery, windings warm, raw at the highest command: {battery_text(battery)} m/s")
    if clocks is not None:
        numbers["clock_check"] = found = clock_numbers(clocks)
        shown += [quantities("\nOther policy clocks, raw", found), records("", found["clocks"])]
    found = Drawn(
        numbers=numbers, shown=[*shown, *plant.remarks], found=searches, draw=lambda: _figure(searches)
    )
    if output is not None:
        with kept(found):
            atomic_write_json(Path(output), found.to_dict())
    return found


def protocol_settings(trials: int, seed: int, **more: Any) -> ProtocolSettings:
    """Settings with nine of ten trials required, rounded up. Raises ``InvalidValueError``."""
    check_range("trials", trials, 1, 10_000)
    return ProtocolSettings(trials=trials, required=-(-trials * 9 // 10), seed=seed, **more)


def first_step(grid: float, every_speed: bool = False) -> float | None:
    """Step of the search's first pass [m/s]: 1 where that is on the grid; ``None`` walks the whole grid."""
    steps = 1.0 / grid if grid > 0.0 else 0.0
    on_grid = 1.0 < steps < math.inf and abs(steps - round(steps)) < 1e-6
    return 1.0 if on_grid and not every_speed else None


def protocol_numbers(result: ProtocolResult) -> dict[str, Any]:
    """The numbers of one search as JSON-ready values: of every command, and of those that stand out."""
    best, running = result.best, result.running
    rows = {speed.top_speed: _speed_numbers(speed) for speed in result.speeds}
    passed = [rows[speed.top_speed] for speed in result.passed]
    clean = [row for row in passed if not row["audit_failed"]]
    bands = [] if best is None else merge_bands(b for trial in best.completed for b in trial.metrics.estimate)
    return json_ready(
        {
            "max_velocity_m_s": result.mean("held_speed"),
            "running_speed_m_s": running and running.running_speed,
            "running_command_m_s": running and running.top_speed,
            "best": passed[-1] if passed else None,
            "fastest": result.fastest and rows[result.fastest.top_speed],
            "fastest_with_audit_passed": max(clean, key=lambda row: row["held_speed_m_s"], default=None),
            "estimate": [asdict(band) for band in bands],
            "speeds": list(rows.values()),
        }
    )


def _speed_numbers(speed: SpeedResult) -> dict[str, Any]:
    failed = audit_trials([trial.metrics for trial in speed.trials]).failed
    told = {item.name: audit_failure(item) for item in failed}
    return {"top_speed_command_m_s": speed.top_speed, **speed.to_dict(), "audit_failed": told}


def _shown(policy: str, searches: dict[str, dict[str, Any]]) -> Iterator[RenderableType]:
    """Raw beside self-paced, then every command, what failed at the best one, errors of the estimate."""
    yield quantities(f"Policy {policy}", *map(_told, searches.values()), names=("raw", "self-paced"))
    for name, search in zip(("raw", "self-paced"), searches.values(), strict=True):
        rows = [
            {key: speed[key] for key in _KEYS} | {"audit failed": ", ".join(speed["audit_failed"])}
            for speed in search["speeds"]
        ]
        yield records(f"\nCommands, {name}", rows)
        yield from ((search["best"] or {}).get("audit_failed") or {}).values()
        if search["estimate"]:
            title = f"\nErrors of the robot's estimate at the highest command passed, {name}: rms, SI units"
            yield records(title, search["estimate"])


def _told(search: dict[str, Any]) -> dict[str, Any]:
    """What stands in the table of a search: all of its best command, of the fastest the speed."""
    short = {
        name: search[name] and {key: search[name][key] for key in _KEYS[:2]}
        for name in ("fastest", "fastest_with_audit_passed")
    }
    best = {**(search["best"] or {}), "audit_failed": None}
    return {**search, **short, "best": None, **best}


def _figure(searches: dict[str, ProtocolResult]) -> Figure:
    """Held speed over the commanded one, raw and self-paced; hollow where trials fell."""
    from sprintlab.core.theme import LIGHT, axis_legend, themed_figure

    figure, (axis,) = themed_figure(LIGHT, (6.4, 4.2), 1, 1)
    for (way, search), colour in zip(searches.items(), (LIGHT.speed, LIGHT.second), strict=True):
        points = [(speed.top_speed, speed.mean("held_speed"), speed.falls) for speed in search.speeds]
        axis.plot(
            *zip(*[point[:2] for point in points], strict=True), "o-", color=colour,
            label=way.replace("_", "-"), markersize=5,
        )  # fmt: skip
        for command, held, falls in points:
            if falls:
                axis.plot(command, held, "o", color=colour, markersize=5, markerfacecolor=LIGHT.background)
    axis.axline((0.0, 0.0), slope=1.0, color=LIGHT.muted, linestyle=":", linewidth=1.0)
    axis.set(xlabel="commanded top speed [m/s]", ylabel="held speed [m/s]")
    axis_legend(axis, LIGHT)
    return figure


def clock_numbers(check: ClockCheck) -> dict[str, Any]:
    """JSON-ready numbers of the trials with other clocks; strides are medians over completed ones."""
    clocks = [
        {
            "policy_rate_Hz": item.clock.rate,
            "period_jitter": item.clock.jitter,
            "trials": item.trials,
            "completed": item.completed,
            "held_speed_m_s": item.held_speed,
            "stride_frequency_Hz": item.stride_frequency,
            "policy_steps_per_stride": item.stride_steps,
            "locked": item.locked,
        }
        for item in check.clocks
    ]
    shares = {"followed_share": check.followed, "greatest_loss_of_speed": check.greatest_loss}
    return json_ready({"top_speed_command_m_s": check.top_speed, "clocks": clocks, **shares})
