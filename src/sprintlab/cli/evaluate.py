"""``sprintlab evaluate``: the protocol with its search for the highest speed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from sprintlab.cli.clock_check import NOTE, clock_numbers, clock_table, clock_verdict
from sprintlab.cli.drive_flags import DriveFlags
from sprintlab.cli.output import plain_table, print_json, progress_bar, stdout_console
from sprintlab.cli.race import policy_path, robot_for
from sprintlab.cli.search_flags import SearchFlags

if TYPE_CHECKING:
    from sprintlab.evaluation.clock_check import ClockCheck
    from sprintlab.evaluation.results import EstimateBand, ProtocolResult, SpeedResult


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Find the highest speed that a policy completes in 9 of 10 seeded trials, raw and self-paced.

    The max velocity is what the policy holds at the highest command that passes. Asked for more than it can
    run, a policy may hold less; so what it holds at most is printed as well.

    Attributes:
        policy: a policy file, or the name of a policy that comes with the package.
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        common_speed: also report J at this speed, to compare policies [m/s].
        clock_check: repeat the highest raw command that passed with the policy's clock at 48 and 52 Hz and
            with periods that vary by 10 %.
        workers: processes; one a core when left out.
        out: also write the JSON here.
        json: print JSON only.
        search: trials and speeds.
        drive: motor model, battery and heat.
    """

    policy: tyro.conf.Positional[str]
    robot: str | None = None
    common_speed: float | None = None
    clock_check: tyro.conf.FlagCreatePairsOff[bool] = False
    workers: int | None = None
    out: Path | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False
    search: SearchFlags = SearchFlags()
    drive: DriveFlags = DriveFlags()

    def run(self) -> int:
        """Run the protocol and print its numbers.

        Raises:
            SprintlabError: the policy, the robot or a setting is refused, or the simulation failed.
        """
        with progress_bar(quiet=self.json) as report:
            report("loading", None)
            results, clocks = self._search(report)
        numbers = {("self_paced" if item.self_paced else "raw"): protocol_numbers(item) for item in results}
        for found in numbers.values():
            found["notes"] = list(self.drive.plant().remarks)
        if clocks is not None:
            numbers["clock_check"] = clock_numbers(clocks)
        if self.out is not None:
            from sprintlab.core.files import atomic_write_json

            atomic_write_json(self.out, numbers)
        if self.json:
            print_json(numbers)
        else:
            _print_numbers(Path(self.policy).stem, {way: numbers[way] for way in ("raw", "self_paced")})
            _print_clocks(clocks)
            for remark in self.drive.plant().remarks:
                stdout_console().print(remark)
        return 0

    def _search(
        self, report: Callable[[str, float | None], None]
    ) -> tuple[list[ProtocolResult], ClockCheck | None]:
        from sprintlab.core.checks import check_positive
        from sprintlab.evaluation.clock_check import check_clock
        from sprintlab.evaluation.pool import TrialPool
        from sprintlab.evaluation.protocol import run_protocol
        from sprintlab.robots import load_robot

        if self.common_speed is not None:
            check_positive("common_speed", self.common_speed, "m/s")
        settings = self.search.protocol(plant=self.drive.plant())
        results = []
        policy = policy_path(self.policy)
        with TrialPool(policy, load_robot(robot_for(policy, self.robot)), self.workers) as pool:
            for paced, name in ((False, "raw"), (True, "self-paced")):
                results.append(
                    run_protocol(
                        pool,
                        self_paced=paced,
                        settings=settings,
                        common_speed=self.common_speed,
                        progress=_speed_progress(report, name, self.search),
                    )
                )
            best = results[0].best
            clocks = None
            if self.clock_check and best is not None:
                report("other policy clocks", None)
                clocks = check_clock(pool, best.top_speed, settings=settings)
        return results, clocks


def _speed_progress(
    report: Callable[[str, float | None], None], name: str, search: SearchFlags
) -> Callable[[SpeedResult], None]:
    def show(speed: SpeedResult) -> None:
        report(f"{name}: {speed.top_speed:g} m/s, {speed.falls} falls", search.share(speed.top_speed))

    return show


def protocol_numbers(result: ProtocolResult) -> dict[str, Any]:
    """The numbers of one search as JSON-ready values; what is not defined becomes null."""
    from sprintlab.evaluation.quantities import json_ready

    best, fastest = result.best, result.fastest
    rows = {speed.top_speed: _speed_numbers(speed) for speed in result.speeds}
    clean = [rows[speed.top_speed] for speed in result.passed if rows[speed.top_speed]["audit_passed"]]
    return json_ready(
        {
            "max_velocity_m_s": result.max_velocity,
            "peak_speed_m_s": result.peak_speed,
            "J_rad2_s": result.angular_cost,
            "J_common_rad2_s": result.angular_cost_common,
            "common_speed_m_s": None if result.common is None else result.common.top_speed,
            "top_speed_command_m_s": None if best is None else best.top_speed,
            "held_steady": None if best is None else best.held_steady,
            "audit_failed": None if best is None else rows[best.top_speed]["audit_failed"],
            "audit_failures": [] if best is None else rows[best.top_speed]["audit_failures"],
            "fastest": None if fastest is None else rows[fastest.top_speed],
            "fastest_with_audit_passed": max(clean, key=lambda row: row["held_speed_m_s"], default=None),
            "estimate": [] if best is None else [asdict(band) for band in best_estimates(best)],
            "cost_of_transport": None if best is None else best.mean("cost_of_transport"),
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


def _print_numbers(policy: str, numbers: dict[str, dict[str, Any]]) -> None:
    console = stdout_console()
    named = {name.replace("_", "-"): row for name, row in numbers.items()}
    console.print(number_table(policy, named))
    for name, row in named.items():
        for failure in row["audit_failures"]:
            console.print(f"audit, {name}, at the highest command: {failure}", soft_wrap=True)
        for what, speeds in audit_failures(row["speeds"]).items():
            commands = ", ".join(f"{speed:g}" for speed in speeds)
            console.print(f"audit, {name}: failed at {commands} m/s ({what})", soft_wrap=True)
    for name, row in named.items():
        if row["estimate"]:
            console.print()
            console.print(_estimate_table(name, row["estimate"]))


def number_table(policy: str, numbers: dict[str, dict[str, Any]]) -> Any:
    """One column a way of giving the command."""
    table = plain_table(f"Policy {policy}", "quantity", *numbers, "unit", numbers=tuple(numbers))
    searches = list(numbers.values())

    def add(label: str, unit: str, *keys: str) -> None:
        table.add_row(label, *(_cell(search, *keys) for search in searches), unit)

    add("max velocity: held at the highest command passed", "m/s", "max_velocity_m_s")
    add("  that command", "m/s", "top_speed_command_m_s")
    add("  held steady", "", "held_steady")
    add("  audit there", "", "audit_failed")
    add("fastest: most that was held", "m/s", "fastest", "held_speed_m_s")
    add("  at the command", "m/s", "fastest", "top_speed_m_s")
    add("  audit there", "", "fastest", "audit_failed")
    add("fastest with the audit passed", "m/s", "fastest_with_audit_passed", "held_speed_m_s")
    add("  at the command", "m/s", "fastest_with_audit_passed", "top_speed_m_s")
    add("peak speed (0.5 s mean) at the highest command", "m/s", "peak_speed_m_s")
    add("J at the highest command", "rad²/s", "J_rad2_s")
    if any(search["common_speed_m_s"] is not None for search in searches):
        add("J at the common speed", "rad²/s", "J_common_rad2_s")
    add("cost of transport at the highest command", "", "cost_of_transport")
    return table


def _cell(search: dict[str, Any], *keys: str) -> str:
    """The value under these keys as text; a dash where something is not defined on the way."""
    value: Any = search
    for key in keys:
        value = None if value is None else value[key]
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return "[bold red]FAILED[/]" if value else "passed"
    return f"{value:.2f}"


def audit_failures(speeds: list[dict[str, Any]]) -> dict[str, list[float]]:
    """Commands [m/s] at which each item of the audit failed, those left out at which every trial fell."""
    found: dict[str, list[float]] = {}
    for speed in speeds:
        if speed["falls"] < speed["trials"]:
            for item in speed["audit_failed"]:
                found.setdefault(item, []).append(speed["top_speed_m_s"])
    return found


def _print_clocks(check: ClockCheck | None) -> None:
    if check is not None:
        console = stdout_console()
        console.print()
        console.print(clock_table(check))
        console.print(f"{NOTE} {clock_verdict(check)}.", style="dim", soft_wrap=True)


def _estimate_table(name: str, bands: list[dict[str, Any]]) -> Any:
    from sprintlab.evaluation.results import EstimateBand
    from sprintlab.evaluation.tables import ESTIMATE_COLUMNS, estimate_cells

    title = f"Estimate against truth at the highest speed, {name}"
    table = plain_table(title, *ESTIMATE_COLUMNS, numbers=ESTIMATE_COLUMNS[1:])
    for row in estimate_cells([EstimateBand(**band) for band in bands]):
        table.add_row(*row)
    return table
