"""How all figures look: colours, sizes, axes and legends, and where Matplotlib is asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from pieper.errors import ArrayError, MissingExtraError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from pieper.spatial._checks import FloatArray


Theme = Literal["light", "dark"]
DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (1.2, 1.2)),
    (0, (6, 1.5, 1.2, 1.5)),
    (0, (9, 2)),
    (0, (3, 1, 1, 1, 1, 1)),
)
SMALL, TEXT, HEAD = 7.5, 8.5, 9.5  # [pt] as in the captions, the text and the headings of a two-column paper
COLUMN, PAGE = 5.2, 7.2  # [inch] width of a figure beside text, and across a page
_MOST_MARKED = 200  # points of a line that still get a marker each
ELEVATION = np.radians(22.0)  # of the eye above a path
_FLAT = 0.4  # least side of the box of a path, relative to the longest: a straight path has a box too


class Colors(NamedTuple):
    """The colours of a theme, as ``#rrggbb``."""

    paper: str
    ink: str
    faint: str
    grid: str
    beyond: str  # what lies outside the limits
    alarm: str
    triad: tuple[str, str, str]  # axes x, y, z
    series: tuple[str, ...]


_THEMES = {
    "light": Colors(
        "#ffffff", "#1f2328", "#8b949e", "#e4e7eb", "#f3dfd3", "#d55e00", ("#d55e00", "#009e73", "#0072b2"),
        ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#4d4d4d"),
    ),
    "dark": Colors(
        "#15181d", "#e6e9ee", "#7d8590", "#2b3038", "#43302a", "#ff8a4c", ("#ff8a4c", "#2fc79a", "#56b4e9"),
        ("#56b4e9", "#e69f00", "#2fc79a", "#e79bc6", "#f0e442", "#ff8a4c", "#c8ccd2"),
    ),
}  # fmt: skip


def need_matplotlib() -> None:
    """Complain where Matplotlib is missing, or does not load."""
    try:
        import matplotlib as mpl  # noqa: F401
    except ImportError as cause:
        raise MissingExtraError("matplotlib", "plot", "a figure") from cause


def new_figure(theme: Theme, width: float, height: float, title: str) -> tuple[Colors, Figure]:
    """An empty figure of a size [inch], and the colours to draw in."""
    if theme not in _THEMES:
        raise ArrayError(f"theme must be 'light' or 'dark', got {theme!r}")
    need_matplotlib()
    from matplotlib.figure import Figure

    colors = _THEMES[theme]
    figure = Figure(figsize=(width, height), facecolor=colors.paper, layout="constrained")
    if title:
        figure.suptitle(title, fontsize=HEAD, color=colors.ink, fontweight="bold")
    return colors, figure


def dress(axes: Any, colors: Colors) -> None:
    """Give axes the grid, the ticks and the words that all figures have."""
    axes.set_facecolor("none")
    axes.grid(True, color=colors.grid, lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=SMALL, labelcolor=colors.ink, color=colors.faint, length=3, which="major")
    axes.tick_params(labelsize=SMALL, labelcolor=colors.ink, color=colors.faint, length=1.8, which="minor")
    for side, spine in axes.spines.items():
        spine.set_color(colors.faint)
        spine.set_visible(side in ("left", "bottom"))
    for axis in (axes.xaxis, axes.yaxis):
        axis.label.set(fontsize=TEXT, color=colors.ink)


def dress_3d(axes: Any, colors: Colors, points: FloatArray, azimuth: float, *, zoom: float = 0.88) -> None:
    """The same in three dimensions, around points (k, 3) [m], looked at from `azimuth` [deg]; metres are equally long along all axes."""
    from matplotlib.ticker import MaxNLocator

    lower, upper = points.min(axis=0), points.max(axis=0)
    size = upper - lower
    longest = max(float(size.max()), 1e-3)
    size = 1.08 * np.maximum(size, _FLAT * longest)
    for name, middle, side in zip("xyz", 0.5 * (lower + upper), size, strict=True):
        getattr(axes, f"set_{name}lim")(middle - 0.5 * side, middle + 0.5 * side)
        axis = getattr(axes, f"{name}axis")
        axis.set_label_text(f"{name} [m]", fontsize=TEXT, color=colors.ink)
        axis.set_pane_color((0.0, 0.0, 0.0, 0.0))
        axis.line.set_color(colors.faint)
        # the one way to colour a grid in three dimensions
        axis._axinfo["grid"].update(color=colors.grid, linewidth=0.6)
        axis.set_tick_params(labelsize=SMALL, colors=colors.ink, pad=0)
        axis.set_major_locator(MaxNLocator(5 if side > 0.75 * size.max() else 3))
    axes.set_facecolor("none")
    axes.set_box_aspect(size, zoom=zoom)  # metres are equally long along the three axes
    axes.view_init(elev=float(np.degrees(ELEVATION)), azim=azimuth)


def legend_below(figure: Figure, colors: Colors, axes: Any, *, columns: int, first: Sequence[str] = ()) -> None:
    """The legend below the figure, where it hides nothing; the labels of `first` before the others."""
    handles, labels = axes.get_legend_handles_labels()
    rank = {label: i for i, label in enumerate(first)}
    order = sorted(range(len(labels)), key=lambda i: rank.get(labels[i], len(rank)))
    figure.legend([handles[i] for i in order], [labels[i] for i in order], loc="outside lower center", ncols=columns, fontsize=SMALL, frameon=False,
                  labelcolor=colors.ink, handlelength=2.8)  # fmt: skip


def legend(axes: Any, colors: Colors, **where: Any) -> None:
    """The legend within axes."""
    axes.legend(
        fontsize=SMALL,
        framealpha=0.85,
        facecolor=colors.paper,
        edgecolor=colors.grid,
        labelcolor=colors.ink,
        **where,
    )


def in_metres(value: float) -> str:
    """Three digits, and as few zeros as can be.

    >>> in_metres(0.010113), in_metres(0.3267), in_metres(1.2e-7)
    ('0.0101 m', '0.327 m', '1.2e-07 m')
    """
    return f"{value:.3g} m"


def dot_size(points: NDArray[Any]) -> float:
    """Size of the marker of each point; none where they would run into each other."""
    return 4.0 if len(points) <= _MOST_MARKED else 0.0
