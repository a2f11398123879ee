"""``sprintlab motor from-datasheet``: a motor file from a data sheet, every conversion written out."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from sprintlab.api.motors import motor_table
from sprintlab.cli.output import plain_table, print_json, show_files, stdout_console
from sprintlab.core.errors import InvalidValueError


@dataclass(frozen=True, kw_only=True)
class MotorFromDatasheet:
    """Turn a data sheet into a motor file; name what is ambiguous or contradictory, guess nothing.

    Attributes:
        sheet: the data sheet (TOML): entries as printed, with their units and conventions.
        template: print a blank data sheet and do nothing else.
        output: motor file to write; none when left out.
        supply_output: supply file to write for --supply of race and evaluate: the drive's I²t as [i2t],
            winding and housing as [heat], where the sheet gives them.
        tolerance: difference between entries that say the same, taken for rounding.
        json: print JSON only.
    """

    sheet: tyro.conf.Positional[Path | None] = None
    template: bool = False
    output: Path | None = None
    supply_output: Path | None = None
    tolerance: float = 0.05
    json: bool = False

    def run(self) -> int:
        """Convert and print; raises ``SprintlabError`` where the sheet is unreadable, unclear or wrong."""
        from sprintlab.workbench.datasheet import (
            conversion_numbers,
            convert_datasheet,
            save_converted_motor,
            save_converted_supply,
        )
        from sprintlab.workbench.datasheet_file import datasheet_template, load_datasheet

        if self.template:
            print(datasheet_template(), end="")
            return 0
        if self.sheet is None:
            raise InvalidValueError("sheet", None, "name a data sheet, or print a blank one with --template")
        written = [os.path.realpath(path) for path in (self.output, self.supply_output) if path is not None]
        if len(set(written)) < len(written):
            raise InvalidValueError("supply_output", str(self.supply_output), "another file than --output")
        sheet = load_datasheet(self.sheet)
        conversion = convert_datasheet(sheet, self.tolerance)
        if self.output is not None:
            save_converted_motor(conversion, sheet, self.output)
        if self.supply_output is not None:
            save_converted_supply(conversion, self.supply_output)
        numbers = conversion_numbers(conversion)
        if self.json:
            print_json(numbers)
        else:
            self._print(sheet.name or self.sheet.stem, numbers)
        return 0

    def _print(self, title: str, numbers: dict[str, Any]) -> None:
        console = stdout_console()
        columns = ("quantity", "formula", "numbers", "result", "unit")
        rows = ({**step, "value": f"{step['value']:.5g}"}.values() for step in numbers["steps"])
        console.print(plain_table(title, *columns, numbers=("result",), rows=rows))
        console.print()
        console.print(motor_table("Motor", "parameter", numbers["motor"], {}))
        for note in numbers["notes"]:
            console.print(f"note: {note}")
        show_files(motor_file=self.output, supply_file=self.supply_output)
