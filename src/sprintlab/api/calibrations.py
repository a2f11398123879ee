"""``calibrate``: tables that make a policy run as fast as it is told, and tell how fast it runs."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from sprintlab.api.policies import OfAPolicy, PolicyChoice, RobotChoice, policy_path, trial_pool
from sprintlab.api.processes import Progress, leave_to_the_parent
from sprintlab.api.tables import plain_table, written_for
from sprintlab.core.arguments import checked
from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import check_writable_file

if TYPE_CHECKING:
    from sprintlab.evaluation.calibration import CalibrationResult

_COLUMNS = (
    "commanded [m/s]", "held before", "error", "estimate's error",
    "given", "held after", "error after", "estimate's error after",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Calibration(OfAPolicy):
    """The calibration tables of one policy, and its errors without and with them.

    Attributes:
        found: the tables and both ladders.
        output: the policy file that was written; ``None`` where the disk had no room for it.
    """

    found: CalibrationResult
    output: Path | None = None

    def tables(self) -> Iterator[RenderableType]:
        """One line a command, and the greatest errors."""
        found = self.found
        title = f"Calibration of {self.policy} on the nominal robot, speeds in m/s"
        table = plain_table(title, *_COLUMNS, numbers=_COLUMNS)
        for before, after in zip(found.before, found.after, strict=True):
            table.add_row(
                f"{before.command:g}",
                f"{before.held:.2f}",
                _signed(before.speed_error),
                _signed(before.estimate_error),
                f"{found.given(before.command):.2f}",
                f"{after.held:.2f}",
                _signed(after.speed_error),
                _signed(after.estimate_error),
            )
        yield table
        (speed_before, estimate_before), (speed, estimate) = map(found.worst, (found.before, found.after))
        yield (
            f"Largest error of the speed up to {found.fastest:.2f} m/s, the most that it holds: "
            f"{speed_before:.2f} m/s before, {speed:.2f} m/s after. "
            f"Of the estimate: {estimate_before:.2f} and {estimate:.2f} m/s."
        )
        if self.output is not None:
            yield f"policy: {self.output}"

    def to_dict(self) -> dict[str, Any]:
        """Plain values, keys with units."""
        output = None if self.output is None else str(self.output)
        return {"policy": self.policy, "output": output, **self.found.to_dict()}


def _signed(error: float) -> str:
    return f"{round(error, 2) + 0.0:+.2f}"  # no minus before a zero


@checked
def calibrate(
    policy: PolicyChoice,
    output: Path | str,
    *,
    top_speed: float,
    lead: float | None = None,
    robot: RobotChoice = None,
    workers: int | None = None,
    progress: Progress = lambda what, share: None,
) -> Calibration:
    """Measure which speeds a policy holds and estimates, and write its file with tables that correct both.

    The nominal robot holds every 1 m/s up to the top speed, without tables and then with them. The network
    stays as it is: the tables are in the new file's contract, whatever tables the old one had.

    Args:
        policy: a policy file, or the name of a policy that comes with the package.
        output: the policy file to write (.onnx); there must be none yet, and what takes its name meanwhile
            is kept: the file then gets a name beside it.
        top_speed: highest command that is measured; the network is never given more [m/s].
        lead: how far the forward command may run ahead of the calibrated estimate [m/s]; as the policy says
            when left out.
        robot: a robot's name, or a parameter table of one's own (.toml); the policy's when left out.
        workers: processes; one a core when left out.
        progress: called with what is being done and the share done.

    Raises:
        SprintlabError: the policy has no estimator, falls, or is refused, or so is the robot or the output.
        UnwrittenError: the disk has no room for the file any more; its ``found`` is the calibration.
    """
    leave_to_the_parent()
    from sprintlab.control.pace import PaceContract
    from sprintlab.evaluation.calibration import LadderSettings, calibrated, write_calibrated

    settings, path, output = LadderSettings(top_speed=top_speed), policy_path(policy), Path(output)
    PaceContract(lead=lead)  # refuses one that is out of range
    _check_new_file(output)
    with trial_pool(path, robot, workers) as pool:
        found = calibrated(pool, settings, lead, progress)
        measured = Calibration(policy=path.stem, found=found)
        with written_for(measured):
            written = write_calibrated(pool.policy, path, found.contract, output)
    return replace(measured, output=written)


def _check_new_file(output: Path) -> None:
    check_writable_file(output)
    if os.path.lexists(output):
        raise SprintlabError(f"{output} exists already: choose another file for the calibrated policy")
