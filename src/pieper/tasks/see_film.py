"""A film of a run by sight: the cell, and in a corner what the camera saw last, with what was found drawn over it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pieper.perception.drawn_color import draw_color
from pieper.perception.upright import draw_upright
from pieper.sim.offscreen import import_pillow
from pieper.sim.scene_view import Recording, SceneView, captioned

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pieper.tasks.see import Look, SeeAndPick

Image = NDArray[np.uint8]

_SHARE = 0.4  # of the film's width
_RIM = 2  # [px]
_GAP = 10  # [px]


class SeeRecording(Recording):
    """Keeps what happens in a run by sight, to be drawn later with what was seen.

    Parameters
    ----------
    run : SeeAndPick
    fps, speed : float
        As for `pieper.sim.scene_view.Recording`.
    """

    def __init__(self, run: SeeAndPick, *, fps: float = 25.0, speed: float = 1.0) -> None:
        super().__init__(run.robot, fps=fps, speed=speed)
        self.run, self._start = run, run.robot.time

    def _images(self, view: SceneView) -> Iterator[Image]:
        light = self.run.light
        looks = list(self.run.looks)
        inset, words = None, ""
        try:
            for k, moment in enumerate(self.moments):
                while looks and looks[0].time <= self._start + k * self._period + 1e-9:
                    look = looks.pop(0)
                    look.light.shine(self.run.robot)
                    inset, words = drawn_look(look), told(look)
                frame = captioned(view.image(moment.positions), moment.caption)
                yield frame if inset is None else with_inset(frame, inset, words)
        finally:
            light.shine(self.run.robot)


def drawn_look(look: Look) -> Image:
    """The picture of a look with what was found, (height, width, 3), red, green, blue."""
    image = np.ascontiguousarray(look.image[..., ::-1])
    if look.found is not None:
        draw_upright(image, look.found, draw_color(look.name.split(" ", maxsplit=1)[0]))
    return np.ascontiguousarray(image[..., ::-1])


def told(look: Look) -> str:
    """What a look found, in words."""
    if look.found is None:
        return f"{look.name}: not seen"
    x, y, _ = look.found.p_base
    return f"{look.name} at ({x:.3f}, {y:.3f}) m"


def with_inset(frame: Image, inset: Image, caption: str = "") -> Image:
    """A picture with a smaller one in its lower right corner."""
    pillow = import_pillow()
    width = round(_SHARE * frame.shape[1])
    height = round(width * inset.shape[0] / inset.shape[1])
    small = captioned(np.asarray(pillow.fromarray(inset).resize((width, height), pillow.Resampling.LANCZOS)), caption)
    out = np.array(frame)
    top, left = frame.shape[0] - height - _GAP, frame.shape[1] - width - _GAP
    out[top - _RIM : top + height + _RIM, left - _RIM : left + width + _RIM] = 255
    out[top : top + height, left : left + width] = small
    return out
