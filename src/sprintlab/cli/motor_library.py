"""``sprintlab motor library``: actuators with published parameters, compared or one by one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.api.actuators import actuators
from sprintlab.cli.output import draw, print_json, show_files, stdout_console


@dataclass(frozen=True, kw_only=True)
class MotorLibrary:
    """Compare the actuators of the library, or print one with the source of every number.

    Attributes:
        name: one actuator; all of them when left out.
        figure: picture of all torque-speed envelopes, absolute and normalised (.png, .pdf or .svg).
        save: write the chosen actuator's motor as a motor file (TOML) for the other commands.
        json: print JSON only.
    """

    name: tyro.conf.Positional[str | None] = None
    figure: Path | None = None
    save: Path | None = None
    json: bool = False

    def run(self) -> int:
        """Print the library or one actuator; raises ``SprintlabError`` for an unknown name."""
        from sprintlab.core.errors import InvalidValueError
        from sprintlab.core.files import check_figure_path
        from sprintlab.motors import save_motor

        check_figure_path(self.figure)
        if self.save is not None and self.name is None:
            raise InvalidValueError("save", str(self.save), "name the actuator to save")
        found = actuators(self.name)
        if self.save is not None:
            save_motor(found.chosen[0].motor, self.save)
        draw(found, self.figure)
        if self.json:
            print_json(list(found.to_dict().values()))
            return 0
        stdout_console().print(found)
        show_files(figure=self.figure, motor_file=self.save)
        return 0
