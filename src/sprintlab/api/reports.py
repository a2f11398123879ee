"""``report``: the log of a run on a robot as figures, numbers and one page, beside its simulation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from sprintlab.api.policies import known_robot, load_policy
from sprintlab.api.results import Progress, Result, kept, silent, table
from sprintlab.control import shipped_policies
from sprintlab.core import files
from sprintlab.core.arguments import checked
from sprintlab.core.checks import check_positive
from sprintlab.core.errors import SprintlabError
from sprintlab.deployment import log as logs
from sprintlab.robots import load_robot


@checked
def report(
    log: Path,
    *,
    output: Path | None = None,
    robot: str | None = None,
    policy: str | None = None,
    distance: float = 100.0,
    simulation: bool = True,
    progress: Progress = silent,
) -> Result:
    """Draw a log of sprintlab run, with the same commands in simulation beside it.

    Example: sprintlab report sprint.mcap

    Args:
        log: the log (.mcap).
        output: result folder, which must not exist; runs/report-<date>-<time> when left out.
        robot: a robot's name, or a parameter table of one's own (.toml); the log's when left out.
        policy: the policy to simulate; the log's when left out, if it comes with the package.
        simulation: simulate the same commands beside the run (--no-simulation: draw the log alone).
    """
    check_positive("distance", distance, "m")
    folder = Path(output) if output else files.default_folder(prefix="report")
    files.check_new_folder(folder)
    progress("reading the log", None)
    log, record = Path(log), logs.read_log(log)
    described = load_robot(robot or known_robot(record.facts["robot"], log.name))
    told = record.facts.get("policy", "sprint")
    if simulation and policy is None and told not in shipped_policies():  # no log chooses a file
        raise SprintlabError(f"{log.name} is of policy {told!r}, unknown here: name its file with --policy")
    from sprintlab.api.log_trial import logged_run
    from sprintlab.evaluation import run_report as runs

    run, simulated = logged_run(record, described, distance), None
    if simulation:
        progress("simulating the same commands", None)
        loaded, command = load_policy(policy or told), run.command[:, 0]
        hold = run.trial.hold_interval
        simulated = runs.simulate_commands(loaded, described, run.command_time, command, hold)
    numbers = {**runs.run_numbers(run, simulated), "faults": run.faults, "facts": record.facts}
    faults = [(f"fault {name}", str(count)) for name, count in run.faults.items()]
    columns = ("robot", "simulation")
    rows = [*runs.number_rows(numbers), *((*fault, "", "") for fault in faults)]
    shown = table("Run", "quantity", *columns, "unit", numbers=columns, rows=rows)
    found = Result(numbers={**numbers, "folder": None}, shown=[shown], found=run)
    with kept(found):
        pictures = runs.make_run_pictures(
            run, simulated, described, lambda what: progress(f"drawing: {what.lower()}", None)
        )
        page = runs.render_run_report(run, simulated, pictures, [*record.facts.items(), *faults])
        with files.atomic_directory(folder) as temporary:
            for picture in pictures:
                files.atomic_write_bytes(temporary / f"{picture.name}.png", picture.png)
            files.atomic_write_json(temporary / "result.json", numbers)
            files.atomic_write_text(temporary / "report.html", page)
    where = f"\nreport: {folder / 'report.html'}"
    return replace(found, numbers={**numbers, "folder": str(folder)}, shown=[shown, where])
