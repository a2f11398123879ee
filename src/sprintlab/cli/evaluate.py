"""``sprintlab evaluate``: the protocol with its search for the highest speed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import tyro

from sprintlab.cli.drive_flags import DriveFlags
from sprintlab.cli.output import plain_table, print_json, progress_bar, stdout_console
from sprintlab.cli.race import policy_path
from sprintlab.cli.search_flags import SearchFlags


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Find the highest speed that a policy completes in 9 of 10 seeded trials, raw and self-paced.

    Attributes:
        policy: a policy file, or the name of a policy that comes with the package.
        robot: a robot's name, or a parameter table of one's own (.toml).
        common_speed: also report J at this speed, to compare policies [m/s].
        workers: processes; one a core when left out.
        out: also write the JSON here.
        json: print JSON only.
        search: trials and speeds.
        drive: motor model, battery and heat.
    """

    policy: tyro.conf.Positional[str]
    robot: str = "bp2"
    common_speed: float | None = None
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
            results = self._search(report)
        numbers = {("self_paced" if item.self_paced else "raw"): protocol_numbers(item) for item in results}
        for found in numbers.values():
            found["notes"] = list(self.drive.plant().remarks)
        if self.out is not None:
            from sprintlab.core.files import atomic_write_json

            atomic_write_json(self.out, numbers)
        if self.json:
            print_json(numbers)
        else:
            _print_numbers(Path(self.policy).stem, numbers)
            for remark in self.drive.plant().remarks:
                stdout_console().print(remark)
        return 0

    def _search(self, report: Callable[[str, float | None], None]) -> list[Any]:
        from sprintlab.core.checks import check_positive
        from sprintlab.evaluation.pool import TrialPool
        from sprintlab.evaluation.protocol import run_protocol
        from sprintlab.evaluation.race_files import chosen_robot

        if self.common_speed is not None:
            check_positive("common_speed", self.common_speed, "m/s")
        settings = self.search.protocol(plant=self.drive.plant())
        results = []
        with TrialPool(policy_path(self.policy), chosen_robot(self.robot), self.workers) as pool:
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
        return results


def _speed_progress(
    report: Callable[[str, float | None], None], name: str, search: SearchFlags
) -> Callable[[Any], None]:
    def show(speed: Any) -> None:
        report(f"{name}: {speed.top_speed:g} m/s, {speed.falls} falls", search.share(speed.top_speed))

    return show


def protocol_numbers(result: Any) -> dict[str, Any]:
    """The numbers of one search as JSON-ready values; what is not defined becomes null."""
    from sprintlab.evaluation.results import ProtocolResult

    assert isinstance(result, ProtocolResult)
    best = result.best
    return {
        "max_velocity_m_s": _defined(result.max_velocity),
        "peak_speed_m_s": _defined(result.peak_speed),
        "J_rad2_s": _defined(result.angular_cost),
        "J_common_rad2_s": _defined(result.angular_cost_common),
        "common_speed_m_s": None if result.common is None else result.common.top_speed,
        "top_speed_command_m_s": None if best is None else best.top_speed,
        "estimate": [] if best is None else [asdict(band) for band in best_estimates(best)],
        "cost_of_transport": None if best is None else _defined(best.mean("cost_of_transport")),
        "speeds": [
            {
                "top_speed_m_s": speed.top_speed,
                "held_speed_m_s": _defined(speed.mean("held_speed")),
                "J_rad2_s": _defined(speed.mean("angular_cost")),
                "falls": speed.falls,
                "trials": len(speed.trials),
                "audit_passed": all(trial.audit.passed for trial in speed.trials),
            }
            for speed in result.speeds
        ],
    }


def best_estimates(best: Any) -> tuple[Any, ...]:
    """Errors of the policy's estimate by speed, over the completed trials; empty without an estimator."""
    from sprintlab.evaluation.estimates import merge_bands

    return merge_bands(band for trial in best.completed for band in trial.metrics.estimate)


def _defined(value: float) -> float | None:
    return value if value == value else None


def _print_numbers(policy: str, numbers: dict[str, dict[str, Any]]) -> None:
    columns = (
        "command",
        "max velocity",
        "peak 0.5 s",
        "J",
        "J at common speed",
        "highest command passed",
        "audit",
    )
    table = plain_table(f"Policy {policy}", *columns, numbers=columns[1:6])
    for name, row in numbers.items():
        tried = [speed for speed in row["speeds"] if speed["falls"] < speed["trials"]]
        clean = bool(tried) and all(speed["audit_passed"] for speed in tried)
        keys = ("max_velocity_m_s", "peak_speed_m_s", "J_rad2_s", "J_common_rad2_s", "top_speed_command_m_s")
        values = ("-" if row[key] is None else f"{row[key]:.2f}" for key in keys)
        table.add_row(name, *values, "passed" if clean else "[bold red]FAILED[/]")
    console = stdout_console()
    console.print(table)
    console.print("speeds in m/s, J in rad²/s")
    for name, row in numbers.items():
        if row["estimate"]:
            console.print()
            console.print(_estimate_table(name, row["estimate"]))


def _estimate_table(name: str, bands: list[dict[str, Any]]) -> Any:
    from sprintlab.evaluation.ablation.table import ESTIMATE_COLUMNS, estimate_cells
    from sprintlab.evaluation.results import EstimateBand

    title = f"Estimate against truth at the highest speed, {name}"
    table = plain_table(title, *ESTIMATE_COLUMNS, numbers=ESTIMATE_COLUMNS[1:])
    for row in estimate_cells([EstimateBand(**band) for band in bands]):
        table.add_row(*row)
    return table
