"""The look that all figures share: colours of a theme, axes, legends, files.

Nothing here touches ``pyplot``, so figures can be made in threads and without a display.
"""

# pyright: reportUnknownMemberType=false
# Matplotlib's type stubs leave its keyword arguments open.

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context  # pyright: ignore[reportUnknownVariableType]
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from sprintlab.core.errors import printable
from sprintlab.core.files import atomic_write_bytes, check_figure_path


@dataclass(frozen=True, kw_only=True)
class Theme:
    """Colours of one look; ``name`` is ``"light"`` or ``"dark"``."""

    name: str
    background: str
    foreground: str
    muted: str
    grid: str
    command: str
    speed: str
    second: str
    on_limit: str  # torque samples that sit on the envelope
    inside: str  # torque samples inside it
    envelope: str
    shade: str
    legs: tuple[str, str, str, str]  # one colour a leg, order FL, FR, RL, RR


LIGHT = Theme(
    name="light",
    background="#ffffff",
    foreground="#1c2430",
    muted="#667085",
    grid="#e4e7ec",
    command="#667085",
    speed="#0b6bcb",
    second="#c2410c",
    on_limit="#d92d20",
    inside="#0b6bcb",
    envelope="#dbeafe",
    shade="#f2f4f7",
    legs=("#0b6bcb", "#0e9384", "#c2410c", "#7a5af8"),
)
DARK = Theme(
    name="dark",
    background="#12161d",
    foreground="#e6e9ef",
    muted="#98a2b3",
    grid="#2a313c",
    command="#98a2b3",
    speed="#5cb0ff",
    second="#ff9559",
    on_limit="#ff6b5e",
    inside="#5cb0ff",
    envelope="#1b2f49",
    shade="#1a202a",
    legs=("#5cb0ff", "#3ccfbf", "#ff9559", "#b5a3ff"),
)


def png_bytes(figure: Figure, dpi: int = 130) -> bytes:
    """The figure as a PNG file: the bytes of ``savefig``, which would draw it twice."""
    buffer, canvas, before = io.BytesIO(), figure.canvas, figure.dpi
    figure.set_dpi(dpi)
    try:
        FigureCanvasAgg(figure).print_png(buffer)
    finally:
        figure.set_dpi(before)
        figure.set_canvas(canvas)
    return buffer.getvalue()


def save_figure(path: str | Path, figure: Figure, dpi: int = 130) -> None:
    """Write a figure in the format that the ending of its name says: ``.png``, ``.pdf`` or ``.svg``.

    Text stays text in PDF and SVG, and the same numbers give the same file.
    """
    check_figure_path(path)
    ending, buffer = Path(path).suffix.removeprefix(".").lower(), io.BytesIO()
    if ending == "png":
        atomic_write_bytes(path, png_bytes(figure, dpi))
        return
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "sprintlab", "pdf.fonttype": 42}):
        undated = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}[ending]
        figure.savefig(buffer, format=ending, dpi=dpi, facecolor=figure.get_facecolor(), metadata=undated)
    atomic_write_bytes(path, buffer.getvalue())


def empty_figure(theme: Theme, size: tuple[float, float]) -> Figure:
    """A figure without axes; size in inches."""
    return Figure(figsize=size, facecolor=theme.background, layout="constrained")


def themed_figure(
    theme: Theme, size: tuple[float, float], rows: int, columns: int, **kwargs: Any
) -> tuple[Figure, list[Axes]]:
    """An empty figure of ``rows`` x ``columns`` axes in a theme's colours, and the axes in reading order."""
    figure = empty_figure(theme, size)
    axes: list[Axes] = list(np.ravel(figure.subplots(rows, columns, squeeze=False, **kwargs)))
    for axis in axes:
        style_axis(axis, theme)
    return figure, axes


def style_axis(axis: Axes, theme: Theme) -> None:
    """The look that all figures share: two spines, a quiet grid, small labels."""
    axis.set_facecolor(theme.background)
    axis.grid(True, color=theme.grid, linewidth=0.7)
    axis.set_axisbelow(True)
    axis.tick_params(colors=theme.muted, labelsize=8, length=3)
    for side, spine in axis.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(theme.muted)
    for text in (axis.xaxis.label, axis.yaxis.label, axis.title):
        text.set_color(theme.foreground)
        text.set_fontsize(9)


def as_written(name: str) -> str:
    """A name from elsewhere as text of a figure: matplotlib reads formulas between dollar signs."""
    return printable(name, 100).replace("$", r"\$")


def set_title(axis: Axes, text: str, theme: Theme, pad: float | None = None) -> None:
    """A short bold title, flush left, ``pad`` points above the axes; formulas stay as they are written."""
    shown = text.replace("$", r"\$")
    axis.set_title(shown, loc="left", pad=pad, fontweight="bold", fontsize=9.5, color=theme.foreground)


def axis_legend(axis: Axes, theme: Theme, *, fontsize: float = 8.0, **kwargs: Any) -> None:
    """A legend of one axis without a frame."""
    axis.legend(frameon=False, fontsize=fontsize, labelcolor=theme.foreground, **kwargs)


def legend_above(axis: Axes, theme: Theme) -> None:
    """A legend to the right above the axes, where no curve can run through it."""
    axis_legend(axis, theme, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.2)


def figure_legend(
    figure: Figure, theme: Theme, handles: Sequence[Artist], columns: int | None = None, place: str = "upper"
) -> None:
    """One legend for all axes of a figure, ``"upper"`` or ``"lower"``, outside of them; one row by itself."""
    where: Any = f"outside {place} center"
    figure.legend(
        handles=handles,
        loc=where,
        ncols=columns or len(handles),
        frameon=False,
        fontsize=8.5,
        labelcolor=theme.foreground,
    )


def labelled(axis: Axes) -> list[Artist]:
    """What an axis would put into its legend."""
    return axis.get_legend_handles_labels()[0]
