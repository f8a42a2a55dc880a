"""A picture of an arm with its frames, and a film of it going to a target, made without a screen."""

from pathlib import Path

import numpy as np

import pieper
from pieper.errors import MissingExtraError, MissingLibraryError
from pieper.ik import target
from pieper.motion import files
from pieper.motion.joint_move import joint_move
from pieper.sim import film
from pieper.sim.picture import Picture

mh12 = pieper.load("mh12")
q_start = np.zeros(6)
answers = mh12.ik(target.ignore_orientation([0.3, 0.3, 0.3]), q_start)
move = joint_move(mh12.chain, q_start, answers.q[0])
files.write(move, "mh12.csv")
print(f"MH12 to {mh12.fk(move.q[-1])[:3, 3].round(4)} m in {move.duration:.2f} s, in mh12.csv")

picture = Picture(size=(480, 360))
picture.add_arm(mh12, move.q[-1], frames=True)
picture.add_arm(mh12, q_start, opacity=0.25, color="#f28c28")
print("frames:", ", ".join(frame.label for frame in picture.frames()))

moving = Picture(size=(320, 240), theme="dark", smooth=False)
moving.add_arm(mh12, files.read("mh12.csv"), trace=True)
try:
    picture.save("mh12.png")
    frames = film.save(moving, "mh12.gif", fps=10)
except (MissingExtraError, MissingLibraryError) as reason:
    print(f"not drawn: {reason}")
else:
    print(f"mh12.png: {Path('mh12.png').stat().st_size // 1000} kB")
    print(f"mh12.gif: {frames} frames, {Path('mh12.gif').stat().st_size // 1000} kB")
