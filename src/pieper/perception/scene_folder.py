"""A scene on disk: the film with everything that the commands ask for, and the truth.

=================  =================================================================================
``video.mp4``      the film, or ``frames/000000.png``, ... without loss
``truth.jsonl``    where everything was, see `truth`
``camera.yaml``    the lens
``field.yaml``     the lens, and where the field lies before it
``patterns.yaml``  the markers on the robots, and the ball
``regions.yaml``   boxes on some frames that show each colour, for ``pieper learn-colour``
=================  =================================================================================
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pieper.atomic_file import write_bytes
from pieper.errors import VisionError
from pieper.perception import truth
from pieper.perception.calibration_file import save_camera, save_view
from pieper.perception.color_regions import Region, regions_as_data
from pieper.perception.opencv import opencv
from pieper.perception.pattern import FORMAT, Patterns
from pieper.perception.scene import Ball, Robot
from pieper.perception.synthetic import Renderer
from pieper.perception.video_file import VideoFile
from pieper.yaml_file import write_yaml

if TYPE_CHECKING:
    from collections.abc import Callable

    from pieper.perception.frame import Image
    from pieper.perception.scene import Scene

VIDEO, FRAMES, TRUTH, CAMERA = "video.mp4", "frames", "truth.jsonl", "camera.yaml"
FIELD, PATTERNS, REGIONS = "field.yaml", "patterns.yaml", "regions.yaml"
_FEWEST_PIXELS = 1  # half the side of a region
_CAPTURES = 3  # of a colour at most, on frames that lie apart


def write(
    scene: Scene,
    folder: str | Path,
    *,
    lossless: bool = False,
    force: bool = False,
    progress: Callable[[int, int], object] | None = None,
) -> int:
    """Draw a scene into a folder; return the number of frames.

    Stopped in between, by Ctrl-C too, it leaves whole files of the frames that there are.

    Parameters
    ----------
    scene : Scene
    folder : str or Path
        Is made if it is not there.
    lossless : bool
        PNG pictures instead of a video.
    force : bool
        Write over what an earlier scene left.
    progress : callable, optional
        Is told after each frame how many are done, and of how many.

    Raises
    ------
    VisionError
        The folder holds a scene already, and `force` is not set.
    """
    to = Path(folder)
    there = [name for name in (VIDEO, FRAMES, TRUTH, CAMERA, FIELD, PATTERNS, REGIONS) if (to / name).exists()]
    if there and not force:
        raise VisionError(
            f"{to} holds {', '.join(there)} already; choose another folder, or write over them with --force"
        )
    if lossless and (to / FRAMES).exists():
        for old in (to / FRAMES).glob("[0-9]*.png"):
            old.unlink()
    to.mkdir(parents=True, exist_ok=True)
    save_camera(to / CAMERA, scene.view.camera)
    save_view(to / FIELD, scene.view, field=(scene.pitch.length, scene.pitch.width), camera_file=to / CAMERA)
    write_yaml(to / PATTERNS, patterns_as_data(Patterns.of_scene(scene)))
    write_yaml(to / REGIONS, regions_as_data(color_regions(scene)))
    film = _Pictures(to / FRAMES) if lossless else VideoFile(to / VIDEO, fps=scene.fps)
    done = 0
    try:
        with (to / TRUTH).open("w", encoding="utf-8") as file:
            truth.begin(file)
            for frame, true in Renderer(scene):
                film.write(frame.image)
                truth.add(file, true)
                done += 1
                if progress is not None:
                    progress(done, len(scene))
    finally:
        film.close()
    return done


class _Pictures:
    """Numbered PNG files."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._count = 0
        folder.mkdir(parents=True, exist_ok=True)

    def write(self, image: Image) -> None:
        _, data = opencv("writing pictures").imencode(".png", image)
        write_bytes(self._folder / f"{self._count:06d}.png", data.tobytes())
        self._count += 1

    def close(self) -> None:
        pass


def patterns_as_data(patterns: Patterns) -> dict[str, Any]:
    """Return what `pattern.load_patterns` reads from YAML."""
    data: dict[str, Any] = {
        "format": FORMAT,
        "robots": [
            {
                "name": robot.name,
                "markers": [
                    {
                        "color": m.color,
                        "position_mm": [round(1e3 * x, 6) for x in m.position],
                        "height_mm": round(1e3 * m.height, 6),
                        "radius_mm": round(1e3 * m.radius, 6),
                    }
                    for m in robot.markers
                ],
            }
            for robot in patterns.robots
        ],
    }
    if patterns.ball is not None:
        data["ball"] = {"color": patterns.ball.color, "radius_mm": round(1e3 * patterns.ball.radius, 6)}
    return data


def color_regions(scene: Scene) -> list[Region]:
    """Return boxes within markers that are wholly seen, up to three of each colour, as a person would drag them."""
    renderer = Renderer(scene)
    found: dict[str, list[Region]] = {}
    for index in np.unique(np.linspace(0, (len(scene) - 1) / 2, _CAPTURES).astype(int)).tolist():
        now: set[str] = set()
        for thing, true in zip(scene.things, renderer.truth(index).objects, strict=True):
            for half, marker in zip(_halves(scene, thing), true.markers, strict=True):
                if marker.visible < 1 or marker.color in now or half < _FEWEST_PIXELS:
                    continue
                u, v = (round(float(x)) for x in marker.image)
                now.add(marker.color)
                region = Region(marker.color, index, u - half, v - half, 2 * half + 1, 2 * half + 1)
                found.setdefault(marker.color, []).append(region)
    return [region for regions in found.values() for region in regions]


def _halves(scene: Scene, thing: Robot | Ball) -> list[int]:
    """Half the side of a square within each marker [px], whichever way it is turned."""
    focal = scene.view.camera.matrix[0, 0]
    scale = focal / float(np.linalg.norm(scene.view.T_camera_field[:3, 3]))
    if isinstance(thing, Ball):
        inner = [thing.radius]
    else:
        inner = [m.radius if m.box is None else min(m.box) / 2 for m in thing.model.markers]
    return [
        max(0, int((radius * scale - 0.7) / np.sqrt(2) - 0.5)) for radius in inner
    ]  # without the mixed pixels of the rim
