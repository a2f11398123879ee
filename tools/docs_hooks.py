"""Hooks of the documentation site: pages made of other files, tables of results, and formulas as MathML."""

from __future__ import annotations

import html
import json
import re
import sys
import textwrap
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File

sys.path.insert(0, str(Path(__file__).parent))
from command_reference import command_reference
from result_tables import tables

from sprintlab.motors import library_motors, load_library_motor

ARCHITECTURE = Path(__file__).parents[1] / "ARCHITECTURE.md"
ARCHITECTURE_PAGE, COMMANDS_PAGE = "architecture.md", "commands.md"
_TABLE = re.compile(r"^( *)\{\{ (\w+) \}\}$", re.MULTILINE)
_BLOCK = re.compile(r'<div class="arithmatex">\\\[(.*?)\\\]</div>', re.DOTALL)
_PICTURE = re.compile(r'(<img alt="[^"]*" src="([^"]+)" ?/>)')
_INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)


def on_files(files: Any, config: Any) -> Any:
    """Add the architecture, and what is written from the code."""
    files.append(File.generated(config, ARCHITECTURE_PAGE, content=architecture()))
    files.append(File.generated(config, COMMANDS_PAGE, content=command_reference()))
    files.append(File.generated(config, "explorer/motors.js", content=motor_library()))
    return files


def architecture() -> str:
    """``ARCHITECTURE.md``, its links those of a page of the site."""
    return ARCHITECTURE.read_text(encoding="utf-8").replace("](docs/", "](")


def motor_library() -> str:
    """The actuators of the library as the envelope explorer reads them, SI units, motor side."""
    entries = [
        {
            "name": actuator.name,
            "title": actuator.title,
            "resistance": float(actuator.motor.stator_resistance),
            "inductance": float(actuator.motor.q_axis_inductance),
            "flux": float(actuator.motor.flux_linkage),
            "polePairs": float(actuator.motor.pole_pairs),
            "peakCurrent": float(actuator.motor.peak_torque / actuator.motor.torque_constant),
            "gear": float(actuator.gear.ratio),
            "bus": float(actuator.bus_voltage),
        }
        for actuator in map(load_library_motor, library_motors())
    ]
    return f"const motorLibrary = {json.dumps(entries)};\n"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Lead to the architecture's page; put tables of the committed results where a page asks, as deep."""
    markdown = markdown.replace(f"](../{ARCHITECTURE.name}", f"]({ARCHITECTURE_PAGE}")
    if not _TABLE.search(markdown):
        return markdown
    found = tables()
    return _TABLE.sub(lambda match: textwrap.indent(found[match[2]], match[1]), markdown)


def on_page_content(content: str, **_: Any) -> str:
    """Replace TeX by MathML, which browsers draw without a script; let a picture open by itself."""
    content = _PICTURE.sub(r'<a href="\2">\1</a>', content)
    content = _BLOCK.sub(lambda match: convert(html.unescape(match[1].strip()), display="block"), content)
    return _INLINE.sub(lambda match: convert(html.unescape(match[1])), content)
