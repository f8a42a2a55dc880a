"""Figures of a workspace map: slices through it, and the whole with a corner cut out. Needs the extra ``plot``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import ArrayError
from pieper.kinematics.fk import fk_frames
from pieper.viewer.figure_look import Theme, dress, new_figure
from pieper.viewer.stance import stance
from pieper.workspace.map import UNITS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pieper.model.chain import Chain
    from pieper.spatial._checks import FloatArray
    from pieper.workspace.map import WorkspaceMap
    from pieper.workspace.place import Placement

_COLORS = "viridis"
_MOST_VOXELS = 2_000_000  # that are looked at
_MOST_POINTS = 30_000  # in three dimensions
_OTHERS = {"x": ("y", "z"), "y": ("x", "z"), "z": ("x", "y")}


def workspace(
    found: WorkspaceMap,
    *,
    quantity: str = "dexterity",
    chain: Chain | None = None,
    title: str = "",
    theme: Theme = "light",
) -> Figure:
    """A map as a figure: of a single layer the layer; else the whole, a slice along the first axis and one across it.

    Parameters
    ----------
    found : WorkspaceMap
        Whole.
    quantity : str
        One of `WorkspaceMap.names`.
    chain : Chain, optional
        The arm, drawn as a line.
    title : str
    theme : "light" or "dark"

    Raises
    ------
    ArrayError
        Nothing is reachable, or the map is not finished.
    UnknownNameError
        No quantity of that name.
    MissingExtraError
        Matplotlib is not installed.
    """
    found.require_complete("a figure")
    shape = found.grid.shape
    flat = [name for name, n in zip("xyz", shape, strict=True) if n == 1]
    links = None if chain is None else _links(chain)
    points, values = found.points(quantity, most=_MOST_VOXELS)
    if not len(points):
        raise ArrayError("nothing in this map is reachable, so that there is nothing to draw")
    pointing = (quantity, found.record["kind"]) == ("dexterity", "directions")  # of which no arm has nearly all
    scale = (0.0, float(values.max()) if pointing else 1.0) if quantity == "dexterity" else _range(values)
    if flat:
        colors, figure = new_figure(theme, 5.2, 4.4, title)
        axes: Any = figure.add_subplot()
        image = _slice(axes, colors, found, quantity, flat[0], float(found.grid.axis(flat[0])[0]), scale, links)
    else:
        colors, figure = new_figure(theme, 10.8, 3.6, title)
        grid = figure.add_gridspec(1, 3, width_ratios=(1.25, 1.0, 1.0))
        y = float(np.clip(0.0, *found.grid.axis("y")[[0, -1]]))
        z = float(_widest(found))
        image = _whole(figure.add_subplot(grid[0], projection="3d"), colors, points, values, scale, y, links)
        _slice(figure.add_subplot(grid[1]), colors, found, quantity, "y", y, scale, links)
        _slice(figure.add_subplot(grid[2]), colors, found, quantity, "z", z, scale, links)
    bar = figure.colorbar(image, ax=figure.axes, shrink=0.8, pad=0.02)
    words = "share of directions" if pointing else UNITS[quantity]
    bar.set_label(words, fontsize=8.5, color=colors.ink)
    bar.ax.tick_params(labelsize=7.5, labelcolor=colors.ink, color=colors.faint)
    bar.outline.set_visible(False)
    return figure


def placement(tried: Placement, Ts_world_target: FloatArray, *, title: str = "", theme: Theme = "light") -> Figure:
    """Base poses that were tried, seen from above: how many poses of the task each place reaches, at its best height and yaw.

    Parameters
    ----------
    tried : Placement
    Ts_world_target : (m, 4, 4) array
        Poses of the task [m, -], drawn as dots.
    title : str
        The name of the arm when not given.
    theme : "light" or "dark"
    """
    colors, figure = new_figure(theme, 5.2, 4.4, title or tried.arm)
    axes: Any = figure.add_subplot()
    x, y = np.unique(tried.bases[:, 0]), np.unique(tried.bases[:, 1])
    most = np.zeros((len(x), len(y)))
    np.maximum.at(most, (np.searchsorted(x, tried.bases[:, 0]), np.searchsorted(y, tried.bases[:, 1])), tried.reached)
    half = [0.5 * (np.diff(each).min() if len(each) > 1 else 0.1) for each in (x, y)]
    span = (x[0] - half[0], x[-1] + half[0], y[0] - half[1], y[-1] + half[1])
    image = axes.imshow(
        most.T, origin="lower", extent=span, cmap=_COLORS, vmin=0, vmax=tried.poses, interpolation="nearest", zorder=1
    )
    targets = np.asarray(Ts_world_target)[:, :2, 3]
    axes.plot(*targets.T, ".", color=colors.alarm, ms=5, label="poses of the task")
    best = tried.bases[tried.best]
    axes.plot(*best[:2], "*", color=colors.alarm, mec=colors.paper, ms=14, label="best base")
    dress(axes, colors)
    axes.set_aspect("equal")
    axes.set_xlabel("x of the base [m]")
    axes.set_ylabel("y of the base [m]")
    axes.legend(fontsize=7.5, loc="upper right")
    bar = figure.colorbar(image, ax=axes, shrink=0.85)
    bar.set_label(f"poses reached, of {tried.poses}", fontsize=8.5, color=colors.ink)
    bar.ax.tick_params(labelsize=7.5, labelcolor=colors.ink, color=colors.faint)
    bar.outline.set_visible(False)
    return figure


def _slice(
    axes: Any,
    colors: Any,
    found: WorkspaceMap,
    quantity: str,
    axis: str,
    value: float,
    scale: tuple[float, float],
    links: FloatArray | None,
) -> Any:
    grid = found.grid
    layer = np.where(found.layer("reached", axis, value) > 0, found.layer(quantity, axis, value), np.nan)
    across, up = _OTHERS[axis]
    i, j = "xyz".index(across), "xyz".index(up)
    span = (grid.lower[i], grid.upper[i], grid.lower[j], grid.upper[j])
    image = axes.imshow(
        layer.T,
        origin="lower",
        extent=span,
        cmap=_COLORS,
        vmin=scale[0],
        vmax=scale[1],
        interpolation="nearest",
        zorder=1,
    )
    if links is not None:
        axes.plot(links[:, i], links[:, j], "-o", color=colors.alarm, lw=1.4, ms=2.5)
    dress(axes, colors)
    axes.set_aspect("equal")
    axes.set_xlabel(f"{across} [m]")
    axes.set_ylabel(f"{up} [m]")
    at = float(grid.axis(axis)[grid.layer(axis, value)])
    axes.set_title(f"{axis} = {at:.3g} m", fontsize=8.5, color=colors.ink)
    return image


def _whole(
    axes: Any,
    colors: Any,
    points: FloatArray,
    values: FloatArray,
    scale: tuple[float, float],
    y: float,
    links: FloatArray | None,
) -> Any:
    """Every reachable voxel but those of the corner towards the eye."""
    half = 0.5 * (points[:, 0].min() + points[:, 0].max())
    kept = (points[:, 1] >= y) | (points[:, 0] < half)
    points, values = points[kept], values[kept]
    step = max(1, len(points) // _MOST_POINTS)
    some = slice(None, None, step)
    size = 900.0 / max(len(points[some]), 1) ** 0.55
    image = axes.scatter(
        *points[some].T, c=values[some], s=size, cmap=_COLORS, vmin=scale[0], vmax=scale[1], lw=0, depthshade=False
    )
    if links is not None:
        axes.plot(*links.T, "-o", color=colors.alarm, lw=1.6, ms=2.5)
    span = points.max(axis=0) - points.min(axis=0)
    axes.set_box_aspect(np.maximum(span, 0.05 * span.max()))
    axes.view_init(elev=22.0, azim=-55.0)
    axes.set_facecolor("none")
    axes.tick_params(labelsize=6, labelcolor=colors.ink, pad=-2)
    axes.set_xlabel("x [m]", fontsize=7.5, color=colors.ink, labelpad=-6)
    axes.set_ylabel("y [m]", fontsize=7.5, color=colors.ink, labelpad=-6)  # that of z would run into the next
    for name in "xyz":
        getattr(axes, f"{name}axis").pane.set_visible(False)
    axes.locator_params(nbins=5)
    return image


def _widest(found: WorkspaceMap) -> float:
    """The height at which most orientations are reached, all voxels of a layer together."""
    total = np.zeros(found.grid.shape[2])
    for region in found.grid.pieces():
        total[region[2]] += found.array("reached", region).sum(axis=(0, 1), dtype=np.float64)
    return float(found.grid.axis("z")[int(np.argmax(total))])


def _links(chain: Chain) -> FloatArray:
    """(k, 3) points along the arm in an easy posture [m]."""
    frames = fk_frames(chain, stance(chain))[:, :3, 3]
    return np.vstack([np.zeros(3), frames])


def _range(values: FloatArray) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
