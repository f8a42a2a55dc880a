"""Ten robots with coloured markers: draw a film with exact truth, learn the colours, follow the robots, and measure the error.

Give a folder to keep what is made: film, annotated film, colours, tracks. `pieper synthesize`, `learn-colour`, `track` and `evaluate`
do the same, one step each.
"""

import math
import sys
import tempfile
from pathlib import Path

from pieper.perception import scene_folder, truth
from pieper.perception.adapt import LightAdaptation
from pieper.perception.calibration_file import load_view
from pieper.perception.color_learning import learn
from pieper.perception.color_regions import read_regions
from pieper.perception.evaluate import evaluate
from pieper.perception.follow import follow
from pieper.perception.output import create_tracks, read_tracks
from pieper.perception.overlay import Overlay
from pieper.perception.pipeline import MarkerTracker
from pieper.perception.scene_presets import preset
from pieper.perception.source import open_source, read_frame
from pieper.perception.video_file import VideoFile


def main(folder: Path) -> None:
    """Do all of it in a folder."""
    # 1. A film of a field, 3 mm to the pixel, and where everything was in each frame.
    scene = preset("clean").but(frames=60)
    scene_folder.write(scene, folder, force=True)
    video = folder / "video.mp4"

    # 2. Colours, from a few boxes on chosen frames.
    regions, _ = read_regions(folder / "regions.yaml")
    learned = learn(lambda n: read_frame(video, n).image, regions, source={"source": video.name})
    learned.model.save(folder / "colors.yaml")
    print(f"learned {', '.join(learned.model.names)} from {len(regions)} boxes")

    # 3. Every frame: patches of colour, robots, tracks; on the field, in metres.
    view = load_view(folder / "field.yaml")
    tracker = MarkerTracker(
        learned.model, view=view, patterns=folder / "patterns.yaml", adaptation=LightAdaptation(learned.model)
    )
    tracks = create_tracks(folder / "tracks.csv", unit=view.unit, source=video.name)
    film = VideoFile(folder / "annotated.mp4", fps=scene.fps)
    with open_source(video) as source:
        run = follow(source, tracker, tracks=tracks, video=film, overlay=Overlay(view, height=0.05))
    tracks.close()
    film.close()
    print(f"followed {len(run.tracks)} things through {run.frames} frames, {run.milliseconds['total']:.1f} ms a frame")

    # 4. Against the truth.
    result = evaluate(truth.read(folder / "truth.jsonl"), read_tracks(folder / "tracks.csv"))
    print(f"position {1e3 * result.position.rms:.2f} mm RMS, heading {math.degrees(result.heading.rms):.2f} deg RMS")
    print(
        f"recall {result.clear.recall:.3f}, precision {result.clear.precision:.3f}, {result.clear.switches} identity switches"
    )


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as folder:
            main(Path(folder))
