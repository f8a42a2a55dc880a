"""Coverage-guided fuzzing of segmentation: frames of any shape, type, strides and bytes, tables of any size.

    python fuzz/fuzz_segment.py -max_total_time=600 CORPUS_FOLDER

Only errors of pieper may come out. A frame that is taken gives what the slow reference gives. A crash of the process is a finding.
"""

from __future__ import annotations

import sys
from pathlib import Path

import atheris
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

with atheris.instrument_imports(include=["pieper"]):
    from pieper._native import kernels
    from pieper.errors import PieperError
    from pieper.perception.color_table import ColorTable
    from pieper.perception.segment import segment

from tests.perception.check_segment import check

DTYPES = ("u1", "i1", "u2", ">u2", "f4", "f8", "?", "O", "U1")
ORDERS = ("bgr", "rgb", "i420", "nv12", "yuyv", "grey")


def some_table(data: atheris.FuzzedDataProvider) -> ColorTable:
    """A table of up to five bits a channel whose labels are drawn."""
    bits = data.ConsumeIntInRange(1, 5)
    drawn = np.frombuffer(data.ConsumeBytes(64) or b"\0", np.uint8)
    labels = np.resize(drawn, (2**bits,) * 3) % 4
    return ColorTable(("a", "b", "c"), labels)


def some_frame(data: atheris.FuzzedDataProvider) -> object:
    """An array that is often a frame."""
    shape = [data.ConsumeIntInRange(0, 70) for _ in range(data.ConsumeIntInRange(0, 3))]
    if data.ConsumeIntInRange(0, 7):
        shape = [*shape[:2], data.ConsumeIntInRange(2, 3)] if data.ConsumeBool() else shape[:2]
    dtype = DTYPES[max(data.ConsumeIntInRange(-12, len(DTYPES) - 1), 0)]
    turned, steps = data.ConsumeIntInRange(0, 5), data.ConsumeIntInRange(1, 3)
    drawn = np.frombuffer(data.ConsumeBytes(4096) or b"\0", np.uint8)
    frame = np.resize(drawn, shape).astype(dtype)
    if turned == 0:
        return frame.tolist()
    if turned == 1 and frame.ndim:
        return frame[::-steps]
    if turned == 2 and frame.ndim > 1:
        return frame[:, ::-steps]
    if turned == 3:
        return np.asfortranarray(frame)
    if turned == 4 and frame.ndim > 1 and frame.shape[0]:
        return np.broadcast_to(frame[:1], frame.shape)
    return frame


def one_input(raw: bytes) -> None:
    """One frame and one table."""
    data = atheris.FuzzedDataProvider(raw)
    sets = kernels.instruction_sets()
    kernels.use_instruction_set(sets[data.ConsumeIntInRange(0, len(sets) - 1)])
    order = ORDERS[data.ConsumeIntInRange(0, len(ORDERS) - 1)]
    least, most = data.ConsumeIntInRange(-1, 20), data.ConsumeIntInRange(0, 9999)
    table, frame = some_table(data), some_frame(data)
    try:
        segment(frame, table, order=order, min_area=least, max_area=most)  # type: ignore[arg-type]
    except PieperError:
        return
    check(frame, table, order, least, most)  # type: ignore[arg-type]


if __name__ == "__main__":
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()
