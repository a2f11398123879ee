"""``sprintlab doctor``: what works here, and what to do about the rest."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import tyro

from sprintlab.api.doctor import Finding, examine
from sprintlab.cli.output import plain_table, print_json, progress_bar, stdout_console, styled

COLOURS = {"ok": "green", "missing": "yellow", "broken": "red", "not tried": "dim"}


@dataclass(frozen=True, kw_only=True)
class Doctor:
    """Try out what sprintlab needs: packages, GPU, graph capture, compiler, OpenGL, disk.

    Exit status 1 where something is broken, 0 otherwise: what is merely not installed is no fault. With
    --training it is 1 too where training on a GPU is not possible.

    What takes long (importing PyTorch, compiling, rendering) is tried with --thorough or --training only.

    Attributes:
        training: also count what GPU training needs and does not find as a fault.
        thorough: also try CUDA, graph capture, compilation and rendering: half a minute and more.
        folder: whose disk runs are to be written to.
        json: print JSON only.
    """

    training: tyro.conf.FlagCreatePairsOff[bool] = False
    thorough: tyro.conf.FlagCreatePairsOff[bool] = False
    folder: Path = Path(".")
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Examine and print; 1 for a fault."""
        with progress_bar(quiet=self.json) as report:
            thorough = self.thorough or self.training
            found = list(examine(self.folder, lambda name: report(name, None), thorough))
        faults = [finding for finding in found if self._is_fault(finding)]
        if self.json:
            print_json({"ok": not faults, "findings": [asdict(finding) for finding in found]})
        else:
            _print_findings(found)
        return 1 if faults else 0

    def _is_fault(self, finding: Finding) -> bool:
        lacking = finding.state == "missing" and finding.needed_for.startswith("training")
        return finding.state == "broken" or (self.training and lacking)


def _print_findings(found: list[Finding]) -> None:
    table = plain_table("sprintlab doctor", "what", "state", "found", "for")
    for finding in found:
        state = styled(f"[{COLOURS[finding.state]}]{finding.state}[/]")
        table.add_row(finding.name, state, finding.found, finding.needed_for)
    console = stdout_console()
    console.print(table)
    for advice, names in _by_advice(found).items():
        console.print(f"{', '.join(names)}: {advice}", soft_wrap=True, markup=False)


def _by_advice(found: list[Finding]) -> dict[str, list[str]]:
    """What to do, each thing once, and for what."""
    names: dict[str, list[str]] = {}
    for finding in found:
        if finding.advice:
            names.setdefault(finding.advice, []).append(finding.name)
    return names
