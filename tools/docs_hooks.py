"""Hooks of the documentation site: files from outside ``docs``, formulas as MathML, folded parts."""

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

ROOT = Path(__file__).parents[1]
OUTSIDE = {
    "README.md": "index.md",
    "ARCHITECTURE.md": "architecture.md",
    "src/sprintlab/robots/README.md": "robots.md",
}
"""Markdown files outside of ``docs`` that are pages of the site."""
_LINK = re.compile(r"\]\(([^)#:\s]+)(#[^)\s]*)?\)")
_BLOCK = re.compile(r'<div class="arithmatex">\\\[(.*?)\\\]</div>', re.DOTALL)
_PICTURE = re.compile(r'(<img alt="[^"]*" src="([^"]+)" ?/>)')
_INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)


def on_files(files: Any, config: Any) -> Any:
    """Add the pages from outside, the command reference, and every file of the sources that a page links."""
    for source, page in OUTSIDE.items():
        files.append(File.generated(config, page, content=moved(ROOT / source)))
    files.append(File.generated(config, "commands.md", content=command_reference()))
    pages = [*(ROOT / "docs").glob("*.md"), *(ROOT / source for source in OUTSIDE)]
    for path in sorted({path for page in pages for path in linked_sources(page)}):
        files.append(File.generated(config, seen_from_docs(path), abs_src_path=str(path)))
    return files


def moved(page: Path) -> str:
    """A page whose links are as seen from ``docs``."""

    def replaced(match: re.Match[str]) -> str:
        return f"]({seen_from_docs(page.parent / match[1])}{match[2] or ''})"

    return _LINK.sub(replaced, page.read_text(encoding="utf-8")).replace('src="docs/', 'src="')


def seen_from_docs(path: Path) -> str:
    """The address of a file of the repository on the site."""
    relative = path.resolve().relative_to(ROOT).as_posix()
    if relative.startswith("docs/"):
        return relative.removeprefix("docs/")
    return OUTSIDE.get(relative, f"source/{relative}")


def linked_sources(page: Path) -> list[Path]:
    """Files outside of ``docs`` that a page links and that are no pages themselves."""
    found = [(page.parent / match[1]).resolve() for match in _LINK.finditer(page.read_text(encoding="utf-8"))]
    return [path for path in found if path.is_file() and seen_from_docs(path).startswith("source/")]


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Point links that leave ``docs`` to the site's copies; let folded parts hold Markdown."""

    def replaced(match: re.Match[str]) -> str:
        outside = match[1].startswith("../")
        target = seen_from_docs(ROOT / "docs" / match[1]) if outside else match[1]
        return f"]({target}{match[2] or ''})"

    return _LINK.sub(replaced, markdown).replace("<details>", '<details markdown="1">')


def on_page_content(content: str, **_: Any) -> str:
    """Replace TeX by MathML, which browsers draw without a script; let a picture open by itself."""
    content = _PICTURE.sub(r'<a href="\2">\1</a>', content)
    content = _BLOCK.sub(lambda match: convert(html.unescape(match[1].strip()), display="block"), content)
    return _INLINE.sub(lambda match: convert(html.unescape(match[1])), content)
