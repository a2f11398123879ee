"""``evaluate``: the highest speed that a policy completes, as one object."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from sprintlab.api.clock_check import NOTE, clock_numbers, clock_table, clock_verdict
from sprintlab.api.drive import DriveOptions
from sprintlab.api.policies import PolicyChoice, RobotChoice, policy_path, trial_pool
from sprintlab.api.processes import Progress, leave_to_the_parent
from sprintlab.api.search import SearchOptions
from sprintlab.api.tables import Drawn, in_notebook, plain_table, styled, written_for
from sprintlab.core.arguments import checked

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sprintlab.evaluation.clock import ClockCheck
    from sprintlab.evaluation.results import EstimateBand, ProtocolResult, SpeedResult, TrialResult


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Evaluation(Drawn):
    """What the search for the highest speed found; prints as tables and draws itself.

    Attributes:
        policy: name of the policy.
        raw: the search with the command as it is.
        self_paced: the search with the command held near the measured speed.
        clock_check: the same speed with other policy clocks; ``None`` where it was not asked for.
        battery: one raw trial at the highest command on battery and warm windings; ``None`` where none passed
            or all trials are.
        notes: what differs from the published numbers' plant.
    """

    policy: str
    raw: ProtocolResult
    self_paced: ProtocolResult
    clock_check: ClockCheck | None = None
    battery: TrialResult | None = None
    notes: tuple[str, ...] = ()

    @property
    def max_velocity(self) -> float:
        """Mean held speed at the highest raw command that passed [m/s]; ``nan`` where none did."""
        return self.raw.mean("held_speed")

    def to_dict(self) -> dict[str, Any]:
        """``raw`` and ``self_paced`` as plain values, keys with units; what is undefined is None."""
        from sprintlab.core.json_values import json_ready
        from sprintlab.evaluation.results import supply_numbers

        found = {"raw": protocol_numbers(self.raw), "self_paced": protocol_numbers(self.self_paced)}
        numbers: dict[str, Any] = {
            name: {**search, "notes": list(self.notes)} for name, search in found.items()
        }
        if self.clock_check is not None:
            numbers["clock_check"] = clock_numbers(self.clock_check)
        if self.battery is not None:
            numbers["battery"] = json_ready(supply_numbers(self.battery))
        return numbers

    def tables(self) -> Iterator[RenderableType]:
        """Raw beside self-paced, failed audits, errors of the estimate, other clocks, remarks."""
        numbers = self.to_dict()
        named = {"raw": numbers["raw"], "self-paced": numbers["self_paced"]}
        yield number_table(self.policy, named)
        for name, row in named.items():
            for failure in row["audit_failures"]:
                yield f"audit, {name}, at the highest command: {failure}"
            for what, speeds in audit_failures(row["speeds"]).items():
                commands = ", ".join(f"{speed:g}" for speed in speeds)
                yield f"audit, {name}: failed at {commands} m/s ({what})"
        for name, row in named.items():
            if row["estimate"]:
                yield from ("", _estimate_table(name, row["estimate"]))
        if self.battery is not None:
            from sprintlab.evaluation.report_text import battery_text

            yield f"on battery, windings warm, raw at the highest command: {battery_text(self.battery)} m/s"
        if self.clock_check is not None:
            yield from ("", clock_table(self.clock_check))
            yield Text(f"{NOTE} {clock_verdict(self.clock_check)}.", style="dim")
        yield from self.notes

    def plot(self) -> Figure:
        """Held speed over the commanded one, raw and self-paced; hollow where trials fell."""
        from sprintlab.core.theme import LIGHT, axis_legend, themed_figure

        figure, (axis,) = themed_figure(LIGHT, (6.4, 4.2), 1, 1)
        for search, label, colour in (
            (self.raw, "raw", LIGHT.speed), (self.self_paced, "self-paced", LIGHT.second)
        ):  # fmt: skip
            commands = [speed.top_speed for speed in search.speeds]
            held = [speed.mean("held_speed") for speed in search.speeds]
            fell = [index for index, speed in enumerate(search.speeds) if speed.falls]
            axis.plot(commands, held, "o-", color=colour, label=label, markersize=5)
            axis.plot(
                [commands[index] for index in fell], [held[index] for index in fell], "o",
                markersize=5, markeredgecolor=colour, markerfacecolor=LIGHT.background,
            )  # fmt: skip
        axis.axline((0.0, 0.0), slope=1.0, color=LIGHT.muted, linestyle=":", linewidth=1.0)
        axis.set(xlabel="commanded top speed [m/s]", ylabel="held speed [m/s]")
        axis_legend(axis, LIGHT)
        return in_notebook(figure)


@checked
def evaluate(
    policy: PolicyChoice = "sprint",
    *,
    robot: RobotChoice = None,
    search: SearchOptions | None = None,
    drive: DriveOptions | None = None,
    common_speed: float | None = None,
    clock_check: bool = False,
    workers: int | None = None,
    output: Path | str | None = None,
    progress: Progress = lambda what, share: None,
) -> Evaluation:
    """Find the highest speed that a policy completes in 9 of 10 seeded trials, raw and self-paced.

    The max velocity is what the policy holds at the highest command that passes. Asked for more than it can
    run, a policy may hold less; so what it holds at most is printed as well.

    Args:
        policy: a policy file, or the name of a policy that comes with the package.
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        search: trials and speeds.
        drive: motor model, battery and heat; the published numbers' when left out.
        common_speed: also report J at this speed, to compare policies [m/s].
        clock_check: repeat the highest raw command that passed with the policy's clock at 48 and 52 Hz and
            with periods that vary by 10 %.
        workers: processes; one a core when left out.
        output: also write the numbers here (JSON).
        progress: called with what is being done and the share done.

    Raises:
        SprintlabError: the policy, the robot, the file or a setting is refused, or the simulation failed.
        UnwrittenError: the disk has no room for the file any more; its ``found`` is the evaluation.
    """
    leave_to_the_parent()
    from sprintlab.core.files import atomic_write_json, check_writable_file
    from sprintlab.evaluation.clock import check_clock
    from sprintlab.evaluation.protocol import battery_request, run_protocol
    from sprintlab.evaluation.trial import check_top_speed

    if common_speed is not None:
        check_top_speed("common_speed", common_speed)
    if output is not None:
        check_writable_file(output)
    search, plant = search or SearchOptions(), (drive or DriveOptions()).plant()
    settings, path = search.protocol(plant=plant), policy_path(policy)
    with trial_pool(path, robot, workers) as pool:
        raw, paced = (
            run_protocol(
                pool,
                self_paced=self_paced,
                settings=settings,
                common_speed=common_speed,
                progress=_speed_progress(progress, name, search),
            )
            for self_paced, name in ((False, "raw"), (True, "self-paced"))
        )
        clocks = None
        if clock_check and raw.best is not None:
            progress("other policy clocks", None)
            clocks = check_clock(pool, raw.best.top_speed, settings=settings)
        request = None if raw.best is None else battery_request(raw.best.top_speed, settings)
        battery = None if request is None else next(iter(pool.trials([request])))
    found = Evaluation(
        policy=path.stem,
        raw=raw,
        self_paced=paced,
        clock_check=clocks,
        battery=battery,
        notes=tuple(plant.remarks),
    )
    if output is not None:
        with written_for(found):
            atomic_write_json(Path(output), found.to_dict())
    return found


def _speed_progress(progress: Progress, name: str, search: SearchOptions) -> Callable[[SpeedResult], None]:
    def show(speed: SpeedResult) -> None:
        progress(f"{name}: {speed.top_speed:g} m/s, {speed.falls} falls", search.share(speed.top_speed))

    return show


def protocol_numbers(result: ProtocolResult) -> dict[str, Any]:
    """The numbers of one search as JSON-ready values; what is not defined becomes null."""
    from sprintlab.core.json_values import json_ready

    best, fastest = result.best, result.fastest
    mean = result.mean
    rows = {speed.top_speed: _speed_numbers(speed) for speed in result.speeds}
    clean = [rows[speed.top_speed] for speed in result.passed if rows[speed.top_speed]["audit_passed"]]
    return json_ready(
        {
            "max_velocity_m_s": mean("held_speed"),
            "running_speed_m_s": None if result.running is None else result.running.running_speed,
            "running_command_m_s": None if result.running is None else result.running.top_speed,
            "peak_speed_m_s": mean("peak_speed"),
            "J_rad2_s": mean("angular_cost"),
            "J_per_second_rad2_s2": mean("angular_cost_rate"),
            "hold_acceleration_m_s2": mean("hold_acceleration"),
            "over_speed_share": mean("over_speed_share"),
            "J_common_rad2_s": result.common and result.common.mean("angular_cost"),
            "common_speed_m_s": None if result.common is None else result.common.top_speed,
            "top_speed_command_m_s": None if best is None else best.top_speed,
            "held_steady": None if best is None else best.held_steady,
            "audit_failed": None if best is None else rows[best.top_speed]["audit_failed"],
            "audit_failures": [] if best is None else rows[best.top_speed]["audit_failures"],
            "fastest": None if fastest is None else rows[fastest.top_speed],
            "fastest_with_audit_passed": max(clean, key=lambda row: row["held_speed_m_s"], default=None),
            "estimate": [] if best is None else [asdict(band) for band in best_estimates(best)],
            "cost_of_transport": mean("cost_of_transport"),
            "stride_frequency_Hz": mean("stride_frequency"),
            "stance_s": mean("stance_time"),
            "duty": mean("mean_duty"),
            "speeds": list(rows.values()),
        }
    )


def _speed_numbers(speed: SpeedResult) -> dict[str, Any]:
    from sprintlab.evaluation.audit import audit_trials
    from sprintlab.evaluation.report_text import audit_failure

    audit = audit_trials([trial.metrics for trial in speed.trials])
    return {
        "top_speed_m_s": speed.top_speed,
        "held_speed_m_s": speed.mean("held_speed"),
        "J_rad2_s": speed.mean("angular_cost"),
        "falls": speed.falls,
        "not_stopped": speed.not_stopped,
        "trials": len(speed.trials),
        "audit_passed": audit.passed,
        "held_steady": speed.held_steady,
        "audit_failed": [item.name for item in audit.failed],
        "audit_failures": [audit_failure(item) for item in audit.failed],
    }


def best_estimates(best: SpeedResult) -> tuple[EstimateBand, ...]:
    """Errors of the policy's estimate by speed, over the completed trials; empty without an estimator."""
    from sprintlab.evaluation.estimates import merge_bands

    return merge_bands(band for trial in best.completed for band in trial.metrics.estimate)


def number_table(policy: str, numbers: dict[str, dict[str, Any]]) -> Table:
    """One column a way of giving the command."""
    table = plain_table(f"Policy {policy}", "quantity", *numbers, "unit", numbers=tuple(numbers))
    searches = list(numbers.values())

    def add(label: str, unit: str, *keys: str) -> None:
        table.add_row(label, *(_cell(search, *keys) for search in searches), unit)

    add("max velocity: held at the highest command passed", "m/s", "max_velocity_m_s")
    add("  that command", "m/s", "top_speed_command_m_s")
    add("held at the highest command without falls, stopping or not", "m/s", "running_speed_m_s")
    add("  that command", "m/s", "running_command_m_s")
    add("held steady at the highest command passed", "", "held_steady")
    add("  audit there", "", "audit_failed")
    add("fastest: most that was held", "m/s", "fastest", "held_speed_m_s")
    add("  at the command", "m/s", "fastest", "top_speed_m_s")
    add("  audit there", "", "fastest", "audit_failed")
    add("fastest with the audit passed", "m/s", "fastest_with_audit_passed", "held_speed_m_s")
    add("  at the command", "m/s", "fastest_with_audit_passed", "top_speed_m_s")
    add("peak speed (0.5 s mean) at the highest command", "m/s", "peak_speed_m_s")
    add("J at the highest command", "rad²/s", "J_rad2_s")
    add("J per second of the hold", "rad²/s²", "J_per_second_rad2_s2")
    if any(search["common_speed_m_s"] is not None for search in searches):
        add("J at the common speed", "rad²/s", "J_common_rad2_s")
    add("cost of transport at the highest command", "", "cost_of_transport")
    add("stride frequency at the highest command", "Hz", "stride_frequency_Hz")
    add("stance at the highest command, median", "s", "stance_s")
    add("duty factor at the highest command", "", "duty")
    return table


def _cell(search: dict[str, Any], *keys: str) -> str | Text:
    """The value under these keys as text; a dash where something is not defined on the way."""
    value: Any = search
    for key in keys:
        value = None if value is None else value[key]
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return styled("[bold red]FAILED[/]") if value else "passed"
    return f"{value:.3f}" if keys[-1] in ("stance_s", "duty") else f"{value:.2f}"


def audit_failures(speeds: list[dict[str, Any]]) -> dict[str, list[float]]:
    """Commands [m/s] at which each item of the audit failed, those left out at which every trial fell."""
    found: dict[str, list[float]] = {}
    for speed in speeds:
        if speed["falls"] < speed["trials"]:
            for item in speed["audit_failed"]:
                found.setdefault(item, []).append(speed["top_speed_m_s"])
    return found


def _estimate_table(name: str, bands: list[dict[str, Any]]) -> Table:
    from sprintlab.evaluation.estimates import ESTIMATE_COLUMNS, estimate_cells
    from sprintlab.evaluation.results import EstimateBand

    title = f"Estimate against truth at the highest speed, {name}"
    rows = estimate_cells([EstimateBand(**band) for band in bands])
    return plain_table(title, *ESTIMATE_COLUMNS, numbers=ESTIMATE_COLUMNS[1:], rows=rows)
