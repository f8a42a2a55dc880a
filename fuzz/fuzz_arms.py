"""Coverage-guided fuzzing of inverse kinematics: arms whose axes coincide, are parallel, meet, or nearly so.

    python fuzz/fuzz_arms.py -max_total_time=600 CORPUS_FOLDER

Every answer has to give its pose back, judged by the textbook product of exponentials; an empty list that is called complete
is one for a pose out of reach; nothing crashes, hangs or raises.
"""

from __future__ import annotations

import sys
from pathlib import Path

import atheris
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

with atheris.instrument_imports(include=["pieper"]):
    from pieper.ik.solve import solver

from tests.degenerate_arms import degenerate_arm
from tests.judge import left
from tests.reference import product_of_exponentials as textbook

TOLERANCE = 1e-9 + 1e-12


def one_input(raw: bytes) -> None:
    """One arm and a few of its poses."""
    data = atheris.FuzzedDataProvider(raw)
    joints = data.ConsumeIntInRange(2, 6)
    arm = degenerate_arm(
        lambda k: data.ConsumeIntInRange(0, k - 1),
        lambda: data.ConsumeFloatInRange(-1.0, 1.0),
        joints,
        slides=data.ConsumeBool(),
    )
    q = np.array([[data.ConsumeFloatInRange(-3.14, 3.14) for _ in range(joints)] for _ in range(3)])
    q[1] = np.clip(np.round(q[1] / (np.pi / 4)) * (np.pi / 4), -np.pi, np.pi)
    wanted = np.stack([textbook.fk(arm, x) for x in q])
    answers = solver(arm).solve(wanted)
    # an empty answer to a pose that the arm has taken must at least not be called complete
    lost = answers.complete & ~answers.valid.any(axis=1)
    assert not lost.any(), f"no answer for a pose of {arm.screws.tolist()}, {arm.home.tolist()}: {q.tolist()}"
    for k, s in zip(*np.nonzero(answers.valid), strict=True):
        assert max(left(textbook.fk(arm, answers.q[k, s]), wanted[k])) <= TOLERANCE


if __name__ == "__main__":
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()
