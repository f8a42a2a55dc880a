"""Colours of a scene, learnt as a person would: from boxes on a few frames."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

from pieper.perception.color_learning import learn
from pieper.perception.report import ReportColor
from pieper.perception.scene_folder import color_regions
from pieper.perception.synthetic import Renderer

if TYPE_CHECKING:
    from pieper.perception.color import ColorModel
    from pieper.perception.frame import Image
    from pieper.perception.scene import Scene


def learned(scene: Scene) -> ColorModel:
    """Return the colour model of boxes on up to three frames of a scene, in the light of its first frame."""
    steady = Renderer(
        scene.but(light=(scene.effects.light[0],) * 2, cast=(scene.effects.cast[0],) * 2, noise=_grain(scene))
    )
    return learn(lambda k: steady[k][0].image, color_regions(scene)).model


def report_colors(scene: Scene) -> list[ReportColor]:
    """Return the report's Gaussians of the same boxes."""
    steady = Renderer(
        scene.but(light=(scene.effects.light[0],) * 2, cast=(scene.effects.cast[0],) * 2, noise=_grain(scene))
    )
    cuts: dict[str, list[Image]] = defaultdict(list)
    for region in color_regions(scene):
        cuts[region.color].append(region.cut(steady[region.frame][0].image))
    return [ReportColor.learn(name, regions, single=name != "green") for name, regions in cuts.items()]


def _grain(scene: Scene) -> float:
    """Noise while learning: paint of one value alone has no covariance, and the report's method would have nothing to invert."""
    return max(scene.effects.noise, 2.0)
