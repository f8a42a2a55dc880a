"""Figures as papers print them: the path of the tip, joints against their limits, errors, manipulability, two models.

Every function returns a Matplotlib `Figure` that belongs to the caller. None of them opens a window, changes a global
setting of Matplotlib or touches pyplot, so that they work in any thread and beside any other figure. `save` writes one to
a file, `show` opens windows. Colours are those of Okabe and Ito, which stay apart for colour-blind readers, and lines that
share axes differ in their dashes as well. Needs the extra ``plot``.

>>> figure = path([[0.2, -0.3, 0.6], [0.3, -0.4, 0.5], [0.5, -0.6, 0.2]])
>>> figure.axes[0].get_xlabel()
'x [m]'
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from pieper.atomic_file import replacing
from pieper.errors import PieperError
from pieper.viewer.compare_figure import Question, compare
from pieper.viewer.error_figure import error
from pieper.viewer.figure_look import Theme, need_matplotlib
from pieper.viewer.joints_figure import joints
from pieper.viewer.manipulability_figure import manipulability
from pieper.viewer.path_figure import StraightLine, path, straight_line

if TYPE_CHECKING:
    import os

    from matplotlib.figure import Figure


__all__ = [
    "FORMATS",
    "Question",
    "StraightLine",
    "Theme",
    "checked_file",
    "compare",
    "error",
    "joints",
    "manipulability",
    "need_screen",
    "path",
    "save",
    "show",
    "straight_line",
]

FORMATS = (".png", ".pdf", ".svg")
"""What `save` writes."""
_WITHOUT_WINDOWS = ("agg", "cairo", "pdf", "pgf", "ps", "svg", "template")


def save(figure: Figure, file: str | os.PathLike[str], *, dpi: int = 200) -> Path:
    """Write a figure as PNG, PDF or SVG, by the suffix; the file is there whole, or not at all.

    Parameters
    ----------
    figure : Figure
    file : path
        Ends in ``.png``, ``.pdf`` or ``.svg``. A file of that name is replaced.
    dpi : int
        Dots per inch of a PNG.

    Returns
    -------
    Path

    Raises
    ------
    PieperError
        Another suffix.
    OSError
        The folder is missing or cannot be written.
    """
    place = checked_file(file)
    kind = place.suffix.lower()[1:]
    dated = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}[kind]  # the same figure, the same file
    with replacing(place) as unfinished:
        figure.savefig(unfinished, format=kind, dpi=dpi, facecolor=figure.get_facecolor(), metadata=dated)
    return place


def checked_file(file: str | os.PathLike[str]) -> Path:
    """The path of a figure, refused before any work where its suffix or its folder cannot be.

    Raises
    ------
    PieperError
        A suffix other than those of `FORMATS`.
    OSError
        No such folder, or a folder of that name.
    """
    place = Path(file)
    if place.suffix.lower() not in FORMATS:
        raise PieperError(
            f"{place}: a figure is written as {', '.join(FORMATS[:-1])} or {FORMATS[-1]}, by the suffix of the file"
        )
    if not place.parent.is_dir():
        raise FileNotFoundError(2, "no such folder", str(place.parent))
    if place.is_dir():
        raise IsADirectoryError(21, "is a folder, not a file", str(place))
    return place


def need_screen() -> None:
    """Complain where `show` would have no screen to open a window on.

    Raises
    ------
    PieperError
        No screen, no toolkit for windows, or a backend of Matplotlib that only writes files.
    """
    need_matplotlib()
    from matplotlib import pyplot as plt

    if plt.get_backend().lower() in _WITHOUT_WINDOWS:
        raise PieperError(
            "there is no screen to show a figure on; write it to a file with --out FILE, or with plot.save"
        )


def show(*figures: Figure) -> None:
    """Open a window for each figure and wait until the last one is closed.

    Raises
    ------
    PieperError
        No screen, see `need_screen`.
    """
    need_screen()
    from matplotlib import pyplot as plt

    for figure in figures:
        # a figure made without pyplot gets the window of one that was made with it
        window: Any = plt.figure(figsize=tuple(figure.get_size_inches())).canvas.manager
        window.canvas.figure = figure
        figure.set_canvas(window.canvas)
        for axes in figure.axes:
            getattr(axes, "mouse_init", lambda: None)()  # so that a picture in three dimensions can be turned
    plt.show(block=True)
