"""A workspace map in the window: its voxels as coloured points, or the surface on which the dexterity passes a level."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.errors import PieperError
from pieper.viewer.panel import Panel, Window
from pieper.workspace.boundary import boundary
from pieper.workspace.map import UNITS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from pieper.spatial._checks import FloatArray
    from pieper.workspace.map import WorkspaceMap

_POINTS, _SURFACE, _NOTHING = "points", "surface", "nothing"
_NO_CUT = "whole"
_CUTS = (_NO_CUT, "behind x", "behind y", "below z")
_MOST_VOXELS = 2_000_000  # that are looked at
_MOST_POINTS = 200_000  # that a browser draws with ease
_SCALE = np.array([[59, 15, 112], [47, 75, 150], [30, 127, 142], [60, 176, 110], [173, 212, 60], [252, 231, 60]], float)
"""Red, green, blue from the least to the greatest: rising in lightness, apart for colour-blind readers."""
_SURFACE_COLOR = (47, 125, 180)


class MapPanel(Panel):
    """A tab of the viewer with a map of the workspace of its arm.

    Parameters
    ----------
    found : WorkspaceMap
        Whole.
    quantity : str
        What the colours show at the beginning.

    Attributes
    ----------
    quantity, drawn, least, cut, at, words
        The controls of viser.
    """

    title = "Map"

    def __init__(self, found: WorkspaceMap, *, quantity: str = "dexterity") -> None:
        found.require_complete("the viewer")
        self._found = found
        self._first = quantity
        self._points, self._dexterity = found.points("dexterity", most=_MOST_VOXELS)
        self._values: dict[str, NDArray[Any]] = {"dexterity": self._dexterity}
        self._handle: Any = None

    def build(self, view: Window) -> None:
        """Make the controls, and draw the map."""
        self._view = view
        gui = view.server.gui
        low, high = self._found.grid.lower, self._found.grid.upper
        self.quantity: Any = gui.add_dropdown("Colour", tuple(UNITS), initial_value=self._first)
        self.drawn: Any = gui.add_dropdown("Drawn", (_POINTS, _SURFACE, _NOTHING), initial_value=_POINTS)
        self.least: Any = gui.add_slider(
            "Dexterity from", 0.0, 1.0, 0.01, 0.0, hint="Of the points; of the surface, the level"
        )
        self.cut: Any = gui.add_dropdown("Cut", _CUTS, initial_value="behind y")
        self.at: Any = gui.add_slider("at [m]", float(low.min()), float(high.max()), self._found.grid.voxel, 0.0)
        self.words: Any = gui.add_html("")
        for control in (self.quantity, self.drawn, self.least, self.cut, self.at):
            control.on_update(self._changed)
        self._draw()

    def _changed(self, _: Any) -> None:
        with self._view.lock, self._view.server.atomic():
            try:
                self._draw()
            except PieperError as error:
                self._view.say(str(error), bad=True)

    def _draw(self) -> None:
        if self._handle is not None:
            self._handle.remove()
            self._handle = None
        scene = self._view.server.scene
        if self.drawn.value == _SURFACE:
            level = float(np.clip(self.least.value, 0.5 / self._found.samples, 1.0 - 0.5 / self._found.samples))
            made = boundary(self._found, level=level)
            self._handle = scene.add_mesh_simple(
                "/map",
                made.vertices.astype(np.float32),
                made.faces.astype(np.uint32),
                color=_SURFACE_COLOR,
                opacity=0.4,
            )
            self._tell(f"dexterity {level:.3g}: {made.volume:.3g} m^3 within {made.area:.3g} m^2")
        elif self.drawn.value == _POINTS:
            values = self._of(self.quantity.value)
            kept = self._shown()
            step = -(-int(kept.sum()) // _MOST_POINTS) if kept.any() else 1
            some = np.flatnonzero(kept)[::step]
            low, high = scale(values)
            self._handle = scene.add_point_cloud(
                "/map",
                self._points[some].astype(np.float32),
                colors(values[some], low, high),
                point_size=0.35 * self._found.grid.voxel,
            )
            self._tell(f"{UNITS[self.quantity.value]}: dark {low:.3g}, light {high:.3g}; {len(some)} voxels")
        else:
            self._tell("")

    def _of(self, quantity: str) -> NDArray[Any]:
        if quantity not in self._values:
            self._values[quantity] = self._found.points(quantity, most=_MOST_VOXELS)[1]
        return self._values[quantity]

    def _shown(self) -> NDArray[np.bool_]:
        """(k,) points on the far side of the cut, with dexterity enough."""
        kept = self._dexterity >= self.least.value
        if self.cut.value != _NO_CUT:
            axis = "xyz".index(self.cut.value[-1])
            beyond = self._points[:, axis] >= self.at.value
            kept &= ~beyond if self.cut.value == "below z" else beyond
        return np.asarray(kept)

    def _tell(self, words: str) -> None:
        self.words.content = f'<div style="margin: 0 1em">{html.escape(words)}</div>'


def scale(values: NDArray[Any]) -> tuple[float, float]:
    """The least and the greatest of the values that are finite."""
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)


def colors(values: NDArray[Any], low: float, high: float) -> NDArray[np.uint8]:
    """(k, 3) colours, dark for the least value and light for the greatest; grey where there is none.

    >>> colors(np.array([0.0, 1.0, np.nan]), 0.0, 1.0).tolist()
    [[59, 15, 112], [252, 231, 60], [128, 128, 128]]
    """
    share: FloatArray = (np.asarray(values, dtype=np.float64) - low) / max(high - low, 1e-300)
    share = np.clip(np.nan_to_num(share, nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
    stops = np.linspace(0.0, 1.0, len(_SCALE))
    made = np.stack([np.interp(share, stops, channel) for channel in _SCALE.T], axis=-1)
    made[np.isnan(values)] = 128.0
    return made.round().astype(np.uint8)
