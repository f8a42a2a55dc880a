"""How good is the perception, and is it as good as it must be? Every pass mark, the report's method beside ours in the same run.

python benchmarks/perception.py             measure (minutes), write results/perception.json, the page and its pictures
python benchmarks/perception.py --page      write the page and its pictures from the data that is there

Give it a quiet machine: the rows of speed are processor times, but two processes on one core share its caches.
"""

import sys

import paired  # before NumPy
import results
from table import origin, table

PAGE = results.HERE.parent / "docs" / "guides" / "perception_figures.md"
IMAGES = results.HERE.parent / "docs" / "images"
METHOD = (
    "scenes drawn with exact truth at 640 x 480 and 3 mm/px unless said; colours learnt from boxes on up to three frames; times are "
    "processor times of one core, every candidate once a round in random order, median of 25 rounds (whole step: 5)"
)
HEAD = """# Scenes, measures and figures of the perception

`benchmarks/perception.py` measures and writes the tables of this page, and `pieper evaluate --marks` prints the first of them.

## Scenes with exact truth

```console
$ pieper synthesize occlusion --count 20 --out film
wrote film  video.mp4 of 20 frames, 0.33 s, and truth.jsonl
```

The other commands take what it wrote:

```bash
pieper learn-colour film/video.mp4 --rois film/regions.yaml --out film/colors.yaml
pieper track film/video.mp4 --colors film/colors.yaml --field film/field.yaml --patterns film/patterns.yaml --out film/tracks.csv
pieper evaluate film/tracks.csv film/truth.jsonl
```

`pieper synthesize` draws robots with marker patterns, a ball and a field through a camera with perspective and lens distortion. Motions are
formulas of time. Outlines cover pixels by exact area, so a picture without noise differs from that of an ideal camera by the rounding to
8 bits alone: centres of discs are true to 0.001 px. The true centre of a marker in the image is the projection of its centre in space;
under perspective the patch that is seen has its centroid elsewhere, by some hundredths of a pixel for a ball at the edge. Motion blur is the
mean over the exposure, and the truth that of its middle.

`--noise`, `--exposure`, `--light`, `--gradient`, `--cast`, `--shadow`, `--quality` change a scene, `--lossless` writes PNG pictures, `--list`
shows the scenes:

![Scenes that are drawn](../images/perception_scenes.jpg)

*{names}. A frame from the middle of each.*

The folder holds `video.mp4`, `truth.jsonl` (a line for each frame: position, heading, velocity and visible share of everything, and the image of
each marker), `camera.yaml`, `field.yaml`, `patterns.yaml`, and `regions.yaml`, boxes that show the colours. Ctrl-C leaves whole files. In Python,
`Renderer(preset("crossing"))` gives frames with their truth, without any file.

## What is measured

`pieper evaluate` compares tracks with the truth frame by frame. An estimate may stand for a thing within 50 mm of it (15 px in pixels). What is less
than half visible need not be found, and its prediction is no false one; how far off it was is told apart.

| figure | is |
| --- | --- |
| position, heading, velocity | RMS, 95 % and largest error of what was seen in its frame |
| hidden | the same of predictions |
| precision, recall, MOTA, identity switches | pairs frame by frame, kept while they hold (CLEAR MOT) |
| IDF1 | the best one-to-one choice of tracks over the whole time |
| HOTA | detection and association in balance, the similarity being 1 at the truth and 1/2 at 50 mm |
| NEES | squared error over its covariance; honest covariances have 95 % of it inside the 95 % band of chi-square |

The tests hold these against `trackeval` and `motmetrics` on random scenes.

## What must be reached

"""


def page(data: dict) -> str:
    """The page, from the data."""
    rows = [
        [
            mark["what"],
            shown(mark, mark["report"]),
            shown(mark, mark["ours"]),
            mark["must"],
            "reached" if mark["reached"] else "**missed**",
        ]
        for mark in data["marks"]
    ]
    reached = sum(mark["reached"] for mark in data["marks"])
    text = HEAD.replace("{names}", data["scenes"])
    text += f"{reached} of {len(rows)} marks are reached. *Report* is the method of the report, exactly as it describes it, in the same run.\n\n"
    text += lines(["what", "report", "pieper", "must", ""], rows) + "\n"
    text += "\n![Ten robots, tracked](../images/perception_tracked.jpg)\n"
    text += (
        "\n*The scene `shadow` with what the tracker says: circles, names, headings, and where everything came from.*\n"
    )
    text += "\n## Each scene in full\n\n"
    text += lines(SCENE_COLUMNS, [scene_row(scene, row) for scene, row in data["figures"].items()]) + "\n"
    best = {m["what"]: m["details"] for m in data["marks"] if "best_opencv" in m["details"]}
    text += "\n## Time to blobs\n\nThree colours, each with area and centroid of its patches; milliseconds of processor time.\n\n"
    for what, details in best.items():
        if "faster" not in what:
            timed = [[name, f"{ms:.3g}"] for name, ms in details["milliseconds"].items()]
            text += f"**{what}**\n\n" + lines(["way", "ms"], timed) + "\n\n"
    return text + f"{origin(data)}\n"


def lines(head: list[str], rows: list[list[str]]) -> str:
    """A Markdown table as text."""
    return "\n".join(table(head, rows))


SCENE_COLUMNS = [
    "scene",
    "position [mm]",
    "95 %",
    "heading [deg]",
    "recall",
    "precision",
    "IDF1",
    "HOTA",
    "switches",
    "NEES inside",
]


def scene_row(scene: str, row: dict) -> list[str]:
    """One scene, as the tracker did on it."""
    degrees = 57.29577951308232
    figures = [
        1e3 * row["position"]["rms"], 1e3 * row["position"]["p95"], degrees * row["heading"]["rms"], row["clear"]["recall"],
        row["clear"]["precision"], row["identity"]["idf1"], row["hota"]["hota"],
    ]  # fmt: skip
    return [
        f"`{scene}`",
        *(f"{value:.3g}" for value in figures),
        str(row["clear"]["switches"]),
        f"{row['nees']['inside']:.1%}",
    ]


def shown(mark: dict, value: float | None) -> str:
    """A figure in words."""
    from pieper.perception.pass_marks import Mark

    return Mark(mark["what"], mark["unit"], 0.0, 0.0).shown(value)


def figures() -> dict[str, dict]:
    """Every scene, tracked with the colours of its first light, following the light."""
    from pieper.perception import pass_marks
    from pieper.perception.scene_presets import PRESETS, preset

    found = {}
    for name in PRESETS:
        print(f"-- scene {name}", file=sys.stderr)
        row = pass_marks.follow(preset(name), adapt=True).result.as_data()
        found[name] = {
            key: row[key]
            for key in ("position", "hidden", "heading", "clear", "identity", "hota", "nees", "heading_nees")
        }
    return found


def pictures() -> str:
    """Draw the scenes and what the tracker sees; return the names in their order."""
    import cv2
    import numpy as np

    from pieper.perception.overlay import Overlay
    from pieper.perception.pass_marks import learned
    from pieper.perception.pattern import Patterns
    from pieper.perception.pipeline import MarkerTracker
    from pieper.perception.scene_presets import preset
    from pieper.perception.synthetic import Renderer

    names = ["clean", "noise", "blur-light", "light-ramp", "shadow", "lens", "occlusion", "crossing", "report"]
    tiles = []
    for name in names:
        scene = preset(name)
        image = Renderer(scene)[182 if name == "crossing" else len(scene) * 2 // 5][0].image
        tiles.append(cv2.resize(image, (400, 300), interpolation=cv2.INTER_AREA))
    sheet = np.vstack([np.hstack(tiles[k : k + 3]) for k in range(0, len(tiles), 3)])
    save = [cv2.IMWRITE_JPEG_QUALITY, 82]
    cv2.imwrite(str(IMAGES / "perception_scenes.jpg"), sheet, save)
    scene = preset("shadow", (960, 720)).but(frames=80)
    tracker = MarkerTracker(learned(scene), view=scene.view, patterns=Patterns.of_scene(scene))
    overlay, drawn = Overlay(scene.view, height=0.06), None
    for frame, _ in Renderer(scene):
        drawn = overlay.draw(frame, tracker.step(frame))
    cv2.imwrite(str(IMAGES / "perception_tracked.jpg"), drawn, save)
    return ", ".join(f"`{name}`" for name in names)


def main() -> None:
    if "--page" not in sys.argv:
        from pieper.perception import pass_marks

        paired.pin_to_one_core()
        marks = pass_marks.measure(begin=lambda title: print(f"-- {title}", file=sys.stderr))
        kept = results.rounded(pass_marks.as_data(marks), 5)
        results.save(
            "perception", method=METHOD, packages=["scipy", "opencv-python-headless"], marks=kept,
            figures=results.rounded(figures(), 5), scenes=pictures(),
        )  # fmt: skip
        for mark in marks:
            print(f"{mark.what}: {mark.shown(mark.ours)}, must be {mark.must}{'' if mark.reached else '  MISSED'}")
    else:
        pictures()
    PAGE.write_text(page(results.load("perception")), encoding="utf-8")


if __name__ == "__main__":
    main()
