"""``sprintlab doctor``: what works here, and what to do about the rest."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.api.doctor import doctor
from sprintlab.cli.output import measure


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
        return 0 if measure(doctor, self).ok else 1
