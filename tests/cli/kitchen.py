"""The help of every verb, its examples, and the files that these read."""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import shutil
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import typer.main

import pieper
from pieper.cli.main import app, main

SCREEN = (40, 80)  # lines and columns
ROOT: Any = typer.main.get_command(app)


def verbs() -> dict[str, Any]:
    """Every verb by the words that name it."""

    def walk(command: Any, words: tuple[str, ...]) -> Any:
        for name, child in getattr(command, "commands", {}).items():
            if hasattr(child, "commands"):
                yield from walk(child, (*words, name))
            elif not child.hidden:
                yield " ".join((*words, name)), child

    return dict(walk(ROOT, ()))


def printed_help(words: str) -> str:
    """What the verb prints in a terminal of 80 columns."""
    command = ROOT
    context = typer.Context(command, info_name="pieper", terminal_width=SCREEN[1], max_content_width=SCREEN[1])
    for word in words.split():
        command = command.commands[word]
        context = typer.Context(
            command, info_name=word, parent=context, terminal_width=SCREEN[1], max_content_width=SCREEN[1]
        )
    return str(command.get_help(context))


def examples(words: str) -> list[str]:
    """The command lines under ``For example:``, each in one line."""
    _, found, rest = printed_help(words).partition("\n  For example:\n")
    text = rest.partition("\n\n")[0].replace("\\\n", " ")
    return [" ".join(line.split()) for line in text.splitlines()] if found else []


MAKER = {
    "clean": "synthesize",
    "colors.yaml": "learn-colour",
    "tracks.csv": "track",
    "move.csv": "move",
    "lab1": "ros record",
}
"""The verb whose example makes what others read."""


class Kitchen:
    """Where the inputs of the examples are made, once: by the example of another verb, or by hand."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def lay(self, words: list[str], verb: str) -> None:
        """Put a copy of everything that an example reads into the present folder."""
        for before, word in pairwise(words):
            name = word.partition("/")[0]
            if before == "--out" or MAKER.get(name) == verb or Path(name).exists():
                continue
            if name in MAKER or hasattr(self, by_hand(name)):
                made = self.made(name)
                (shutil.copytree if made.is_dir() else shutil.copy)(made, name)

    def made(self, name: str) -> Path:
        """The input of that name, in a folder of its own."""
        folder = self.folder / f"for {name}"
        if not folder.exists():
            folder.mkdir()
            with inside(folder):
                if name in MAKER:
                    words = shlex.split(examples(MAKER[name])[0])[1:]
                    self.lay(words, MAKER[name])
                    assert main(words) == 0
                else:
                    getattr(self, by_hand(name))(folder)
        return folder / name

    def make_world_yaml(self, folder: Path) -> None:
        post = "obstacles:\n  - {name: post, box: [0.2, 0.1, 0.8], position: [0.55, 0, 0.4]}\n"
        (folder / "world.yaml").write_text(post)

    def make_task_csv(self, folder: Path) -> None:
        poses = "x,y,z,roll,pitch,yaw\n0.4,0.2,0.2,3.14159,0,0\n0.4,-0.1,0.3,3.14159,0,1.57\n"
        (folder / "task.csv").write_text(poses)

    def make_measured_csv(self, folder: Path) -> None:
        from pieper.kinematics.measurements import write_measurements
        from tests.kinematics.test_calibration import built, joints

        nominal = pieper.load("ur5e").chain
        q = joints(nominal, 60)
        write_measurements(folder / "measured.csv", nominal, q, pieper.load(built(nominal, 4, 0.003)).fk(q)[:, :3, 3])

    def make_pictures(self, folder: Path) -> None:
        import cv2

        from pieper.perception.board import Board
        from pieper.perception.camera import Camera
        from tests.perception.board_scene import RayCaster, looking_at

        lens = Camera([[330, 0, 161.7], [0, 332, 118.2], [0, 0, 1]], [-0.2, 0.05, 0, 0], (320, 240))
        board, rays = Board.parse("charuco:7x5:0.03:0.022"), RayCaster(lens, sides=3)
        (folder / "pictures").mkdir()
        rng = np.random.default_rng(0)
        for k in range(6):
            tilt, turn, roll = rng.uniform(-0.5, 0.5, 3)
            at = np.array(board.size) * rng.uniform(0.3, 0.7, 2)
            T = looking_at(at, distance=0.26, tilt=tilt, turn=turn, roll=roll)
            cv2.imwrite(str(folder / "pictures" / f"{k}.png"), rays.image(T, board.is_white, blur=0.5, noise=1, seed=k))

    def make_camera_yaml(self, folder: Path) -> None:
        from pieper.perception.calibration_file import save_camera
        from tests.perception.test_field import TRUE

        save_camera(folder / "camera.yaml", TRUE)

    def make_field_png(self, folder: Path) -> None:
        import cv2

        from pieper.perception import field_lines
        from tests.perception.board_scene import RayCaster
        from tests.perception.test_field import TRUE, VIEW

        lines = field_lines.lines("vsss")
        image = RayCaster(TRUE, sides=3).image(
            VIEW.T_camera_field, lambda p: 0.15 + 0.7 * lines.is_white(p), blur=0.6, noise=3
        )
        cv2.imwrite(str(folder / "field.png"), image)

    def make_captures_csv(self, folder: Path) -> None:
        from pieper.spatial import rotation
        from tests.perception.test_hand_eye import made_up

        _, _, hands, seen = made_up(8, 0)
        rows = ["x,y,z,qx,qy,qz,qw,camera_x,camera_y,camera_z,camera_qx,camera_qy,camera_qz,camera_qw"]
        for pair in zip(hands, seen, strict=True):
            numbers = [n for T in pair for n in (*T[:3, 3], *rotation.as_quaternion(T[:3, :3]))]
            rows.append(",".join(f"{n:.9g}" for n in numbers))
        (folder / "captures.csv").write_text("\n".join(rows) + "\n")


def by_hand(name: str) -> str:
    return "make_" + re.sub(r"\W", "_", name)


@contextlib.contextmanager
def inside(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)
