"""The tab with a map: points, a cut, a surface, and colours from the least to the greatest."""

from __future__ import annotations

import numpy as np
import pytest

import pieper
from pieper.errors import ArrayError
from pieper.workspace.run import run
from pieper.workspace.survey import survey

pytest.importorskip("viser", reason="the viewer's extra is not installed")

from pieper.viewer.map_panel import MapPanel, colors
from pieper.viewer.server import Server
from pieper.viewer.view import View


def test_the_map_is_points_or_a_surface():
    arm = pieper.load("ur5e")
    found = run(survey(arm, voxel=0.3, orientations=8))
    panel = MapPanel(found)
    with View(Server(port=0), arm, panels=[panel]) as view:
        centres, share = found.points("dexterity")
        assert len(panel._handle.points) == int((centres[:, 1] >= 0.0).sum())
        panel.cut.value = "whole"
        panel.least.value = 0.5
        panel._changed(None)
        assert len(panel._handle.points) == int((share >= 0.5).sum())
        panel.quantity.value = "manipulability"
        panel._changed(None)
        assert "manipulability: dark" in panel.words.content
        panel.drawn.value = "surface"
        panel._changed(None)
        assert len(panel._handle.vertices) > 20
        panel.drawn.value = "nothing"
        panel._changed(None)
        assert panel._handle is None
        assert view.arm is arm


def test_a_map_that_is_not_finished_is_not_shown():
    half = run(survey(pieper.load("ur5e"), voxel=0.3, orientations=3, chunk=3), stop=lambda: True)
    with pytest.raises(ArrayError, match="the viewer needs the whole map"):
        MapPanel(half)


def test_colours_rise_in_lightness():
    made = colors(np.linspace(0.0, 1.0, 30), 0.0, 1.0).astype(float)
    lightness = made @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(lightness) > 0.0).all()
