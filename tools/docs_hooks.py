"""Hooks of the documentation site: the generated page of commands, and formulas as MathML."""

from __future__ import annotations

import html
import re
import sys
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File

sys.path.insert(0, str(Path(__file__).parent))
from command_reference import command_reference

COMMANDS_PAGE = "commands.md"
_BLOCK = re.compile(r'<div class="arithmatex">\\\[(.*?)\\\]</div>', re.DOTALL)
_INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)


def on_files(files: Any, config: Any) -> Any:
    """Add the page that is written from the code."""
    files.append(File.generated(config, COMMANDS_PAGE, content=command_reference()))
    return files


def on_page_content(content: str, **_: Any) -> str:
    """Replace TeX by MathML, which browsers draw without a script."""
    content = _BLOCK.sub(lambda match: convert(html.unescape(match[1].strip()), display="block"), content)
    return _INLINE.sub(lambda match: convert(html.unescape(match[1])), content)
