"""``sprintlab evaluate``: the protocol with its search for the highest speed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.api.drive import DriveOptions
from sprintlab.api.evaluations import evaluate
from sprintlab.api.search import SearchOptions
from sprintlab.cli.output import print_json, progress_bar, stdout_console


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
    clock_check: bool = False
    workers: int | None = None
    out: Path | None = None
    json: bool = False
    search: SearchOptions = SearchOptions()
    drive: DriveOptions = DriveOptions()

    def run(self) -> int:
        """Run the protocol and print its numbers.

        Raises:
            SprintlabError: the policy, the robot or a setting is refused, or the simulation failed.
        """
        with progress_bar(quiet=self.json) as report:
            report("loading", None)
            found = evaluate(
                self.policy,
                robot=self.robot,
                search=self.search,
                drive=self.drive,
                common_speed=self.common_speed,
                clock_check=self.clock_check,
                workers=self.workers,
                progress=report,
            )
        if self.out is not None:
            from sprintlab.core.files import atomic_write_json

            atomic_write_json(self.out, found.to_dict())
        if self.json:
            print_json(found.to_dict())
        else:
            stdout_console().print(found, soft_wrap=True)
        return 0
