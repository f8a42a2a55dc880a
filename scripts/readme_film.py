"""Film the run at the top of the README: ``python scripts/readme_film.py`` writes docs/images/see_solve_pick.webp.

A UR10e takes a can from a table. A calibrated camera says where the cans are; `arm.ik` lists every answer for the grasp, each shown as a
ghost, red where it would touch something; then it is picked, with contact physics. The ghosts are of the very grasp that follows.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

from pieper.model.description import Box, Cylinder
from pieper.perception.upright import cylinder_outline
from pieper.sim.ghost import Ghost
from pieper.sim.light import SceneLight
from pieper.sim.scene import SceneCamera, SceneObject, at
from pieper.sim.scene_view import Recording, SceneView
from pieper.tasks import see

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from pieper.tasks.pick import Stage

    Image = NDArray[np.uint8]

FILE = Path(__file__).parents[1] / "docs" / "images" / "see_solve_pick.webp"
SIZE, FPS, SPEED = (800, 450), 15.0, 1.5
SEED = 1
QUALITY = 86
INSET, GAP, RIM = 0.34, 12, 2  # of the width; pixels
LOOKED_AT, FOUND, SOLVED, BLOCKED, CHOSEN = 0.8, 1.8, 2.0, 1.0, 0.8  # [s] of film before the arm moves
LAST = 0.8  # [s] the end is shown
FREE, TOUCHES, TAKEN = "#2f7fd1", "#d3382f", "#f28c28"
DOING = {
    "reach": "the arm moves, with\nmass and contacts",
    "close gripper": "grips by friction",
    "retract": "lifts it",
    "move to bin": "and carries it\nto the bin",
    "release": "lets go",
}
"""Words for what is done until a stage ends."""
INK, HALO = "#1b1f24", "#ffffff"


@dataclass(frozen=True, eq=False)
class Answers:
    """Every answer for the grasp, (k, n), and what the arm would touch there, in words."""

    q: NDArray[np.float64]
    touches: list[str]


EYE, TARGET, VIEW = [2.3, -1.6, 1.5], [0.52, 0.42, 0.14], 36.0  # [m], [m], [deg] of the film


def staged() -> see.SeeTask:
    """The task with a camera for the film, and something to be seen where the camera that looks is."""
    task = see.see_task("ur10e")
    scene = task.pick.scene
    eye = task.scene_camera.T_world_camera
    behind = eye @ at(0.0, 0.0, -0.06)  # nothing that the camera sees
    pole = 0.5 * (behind[2, 3] + scene.floor)
    things = (
        SceneObject("camera", Box(np.array([0.07, 0.07, 0.1])), behind, color="#23272e"),
        SceneObject("lens", Cylinder(0.025, 0.03), eye @ at(0.0, 0.0, -0.016), color="#4a90d9"),
        SceneObject("pole", Cylinder(0.014, behind[2, 3] - scene.floor), at(behind[0, 3], behind[1, 3] - 0.05, pole), color="#6d747c"),
    )  # fmt: skip
    film = SceneCamera.looking("film", EYE, TARGET, field_of_view=float(np.radians(VIEW)))
    scene = replace(scene, objects=(*scene.objects, *things), cameras=(*scene.cameras, film))
    return replace(task, pick=replace(task.pick, scene=scene))


class Film:
    """A run, and the frames that tell it."""

    def __init__(self, seed: int) -> None:
        self.task = staged()
        self.run = see.SeeAndPick(self.task, seed=seed, log=self.told)
        self.stages: list[Stage] = []
        self.answers = Answers(np.zeros((0, 6)), [])
        self.seen: dict[str, NDArray[np.float64]] = {}

    def told(self, stage: Stage) -> None:
        """Solve for the grasp once the can was seen, as the run does next."""
        self.stages.append(stage)
        if len(self.stages) == 1:
            found = self.run.looks[0].found
            assert found is not None, "choose another seed: the first can is not seen"
            x, y, z = found.p_base
            T_grasp = self.task.pick.grasp_at(at(x, y, z, yaw=float(np.arctan2(y, x))))
            q = self.task.pick.arm.ik(T_grasp).q
            self.seen = dict(self.run.seen)
            self.answers = Answers(q, [self.run.blocked(row) for row in q])

    def play(self) -> None:
        """Run one cycle."""
        with self.run:
            self.run.fill_slots(1)
            self.run.light = SceneLight()  # not a random one: the film is to be looked at
            self.run.light.shine(self.run.robot)
            self.recording = Recording(self.run.robot, fps=FPS, speed=SPEED)
            self.start = self.run.robot.time
            cycle = self.run.cycle(1)
        assert cycle.placed, f"choose another seed: {cycle.reason}"

    def taken(self) -> int:
        """Which answer the arm went to."""
        moment = self.recording.moments[self.moment(self.end("reach"))]
        q = moment.positions[: self.answers.q.shape[1]]
        turn = self.answers.q - q
        return int(np.argmin(np.abs((turn + np.pi) % (2 * np.pi) - np.pi).max(axis=1)))

    def end(self, name: str) -> float:
        """When a stage ends [s]."""
        return next(stage.end for stage in self.stages if stage.name == name)

    def moment(self, time: float) -> int:
        """Which moment of the recording shows a time."""
        return round((time - self.start) / SPEED * FPS)

    def frames(self) -> Iterator[Image]:
        """Look, solve, choose, pick."""
        answers, taken, moments = self.answers, self.taken(), self.recording.moments
        free = [k for k, why in enumerate(answers.touches) if not why]
        look = self.run.looks[0]
        raw, marked = look.image, self.marked()
        x, y = look.found.p_base[:2]
        first = moments[0].positions

        def held(seconds: float) -> range:
            return range(round(seconds * FPS))

        visual = self.run.robot.model.vis
        visual.map.shadowclip, visual.quality.shadowsize = 4.0, 4096  # shadows all over the floor
        with SceneView(self.run.robot, "film", size=SIZE, smooth=True) as view:
            rest = view.image(first)
            for words, picture, seconds in (
                ("a picture of the table", raw, LOOKED_AT),
                (f"{look.name} at\n({x:.3f}, {y:.3f}) m", marked, FOUND),
            ):
                shown = self.written(rest, "1  See", words, picture)
                for _ in held(seconds):
                    yield shown
            count = len(answers.q)
            for step in held(SOLVED):
                last = min(count, 1 + int(step * (count + 1) / (SOLVED * FPS)))
                ghosts = [Ghost(q, FREE, 0.38) for q in answers.q[:last]]
                words = f"arm.ik(T):\n{last} of {count} answers"
                yield self.written(view.image(first, ghosts=ghosts), "2  Solve", words, marked)
            ghosts = [
                Ghost(q, TOUCHES, 0.3) if why else Ghost(q, FREE, 0.38)
                for q, why in zip(answers.q, answers.touches, strict=True)
            ]
            words = f"{count - len(free)} would touch something,\n{len(free)} are free"
            shown = self.written(view.image(first, ghosts=ghosts), "2  Solve", words, marked)
            for _ in held(BLOCKED):
                yield shown
            one = Ghost(answers.q[taken], FREE, 0.5)
            shown = self.written(view.image(first, ghosts=[one]), "2  Solve", "taken: the one with\nthe shortest free way", marked)  # fmt: skip
            for _ in held(CHOSEN):
                yield shown
            for k, moment in enumerate(moments):
                words = next((words for name, words in DOING.items() if k < self.moment(self.end(name))), "placed")
                ghosts = [one] if k < self.moment(self.end("reach")) else []
                yield self.written(view.image(moment.positions, ghosts=ghosts), "3  Pick", words, marked)
            shown = self.written(view.image(moments[-1].positions), "3  Pick", "placed", marked)
            for _ in held(LAST):
                yield shown

    def marked(self) -> Image:
        """The camera's picture with the outline of every can where it was found."""
        canvas = Pillow.fromarray(self.run.looks[0].image)
        pen = ImageDraw.Draw(canvas)
        font = ImageFont.load_default(26)
        for name, T in self.seen.items():
            can = self.task.can(name)
            outline = cylinder_outline(
                self.run.camera, self.run.calibration.T_base_camera(), T[:3, 3], can.radius, can.length
            )
            points = [tuple(point) for point in [*outline, outline[0]]]
            pen.line(points, fill=HALO, width=7, joint="curve")
            pen.line(points, fill=see.COLORS[name], width=4, joint="curve")
            middle, low = outline.mean(axis=0), outline[:, 1].max()
            text = f"{T[0, 3]:.2f}, {T[1, 3]:.2f} m"
            wide = pen.textlength(text, font=font)
            pen.text((middle[0] - wide / 2, low + 6), text, font=font, fill=INK, stroke_width=3, stroke_fill=HALO)
        return np.array(canvas)

    def written(self, frame: Image, title: str, words: str, inset: Image) -> Image:
        """A frame with its caption, and below it the camera's picture."""
        canvas = Pillow.fromarray(frame)
        wide = round(INSET * SIZE[0])
        high = round(wide * inset.shape[0] / inset.shape[1])
        left, top = SIZE[0] - wide - GAP, SIZE[1] - high - GAP
        pen = ImageDraw.Draw(canvas)
        pen.rectangle((left - RIM, top - RIM, left + wide + RIM - 1, top + high + RIM - 1), fill=HALO)
        canvas.paste(Pillow.fromarray(inset).resize((wide, high), Pillow.Resampling.LANCZOS), (left, top))
        for text, size, high in ((title, 34, 16), (words, 21, 66)):
            pen.multiline_text(
                (left, high), text, font=ImageFont.load_default(size), fill=INK, stroke_width=3, stroke_fill=HALO, spacing=7,
            )  # fmt: skip
        pen.text(
            (left + 8, top + 5), "what the camera sees", font=ImageFont.load_default(15), fill=INK, stroke_width=2, stroke_fill=HALO,
        )  # fmt: skip
        return np.array(canvas)


def main() -> None:
    """Run, draw and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--frames", type=Path, help="also write every frame as a PNG file into this folder")
    arguments = parser.parse_args()
    film = Film(arguments.seed)
    film.play()
    print(f"{len(film.answers.q)} answers; taken: {film.taken()}")
    for k, why in enumerate(film.answers.touches):
        print(f"  {k}: {why or 'free'}")
    pictures = []
    for k, frame in enumerate(film.frames()):
        pictures.append(Pillow.fromarray(frame))
        if arguments.frames is not None:
            arguments.frames.mkdir(parents=True, exist_ok=True)
            pictures[-1].save(arguments.frames / f"{k:03d}.png")
    pictures[0].save(
        FILE, save_all=True, append_images=pictures[1:], duration=round(1000.0 / FPS), loop=0, quality=QUALITY, method=6,
    )  # fmt: skip
    print(f"{FILE.name}: {len(pictures)} frames, {len(pictures) / FPS:.1f} s, {FILE.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
