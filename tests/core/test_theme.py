"""Figures as files."""

import io

import pytest

from sprintlab.core.theme import (
    LIGHT,
    figure_legend,
    png_bytes,
    save_figure,
    themed_figure,
)


def two_panels(theme):
    """Axes of different sizes, with a title of the figure and a legend outside."""
    figure, axes = themed_figure(theme, (4.0, 2.0), 1, 2)
    curves = [
        axis.plot([0.0, 1.0], [0.0, top], label=f"to {top:g}")[0]
        for axis, top in zip(axes, (1, 1e5), strict=True)
    ]
    axes[1].set_ylabel("torque\n[N m]")
    figure.suptitle("Two motors")
    figure_legend(figure, theme, curves)
    return figure


def saved(figure, dpi=130):
    """PNG file as matplotlib's own ``savefig`` writes it."""
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=dpi, facecolor=figure.get_facecolor())
    return buffer.getvalue()


def test_a_png_is_that_of_savefig_and_leaves_the_figure_as_it_was():
    figure = two_panels(LIGHT)
    canvas, dpi = figure.canvas, figure.dpi
    assert png_bytes(figure, 90) == saved(two_panels(LIGHT), 90)
    assert figure.canvas is canvas and figure.dpi == dpi


@pytest.mark.parametrize("ending", ["pdf", "svg"])
def test_the_same_drawing_gives_the_same_bytes(tmp_path, ending):
    for name in ("one", "two"):
        save_figure(tmp_path / f"{name}.{ending}", two_panels(LIGHT))
    assert (tmp_path / f"one.{ending}").read_bytes() == (tmp_path / f"two.{ending}").read_bytes()
