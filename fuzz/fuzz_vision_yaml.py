"""Fuzz the YAML readers of the perception room: whatever comes in, only `PieperError` may come out.

    python fuzz/fuzz_vision_yaml.py -max_total_time=600 [corpus_dir]

Half of the inputs are raw bytes; the other half are good files with pieces cut out, put in or repeated, so that the checks behind the YAML
parser are reached too. What is read as a colour model has to compile to a table and to be written and read again.
"""

from __future__ import annotations

import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["pieper.perception", "pieper.yaml_file", "yaml"]):
    import numpy as np

    from pieper.errors import PieperError
    from pieper.perception.calibration_file import load_camera, load_field_size, load_view
    from pieper.perception.color import ColorModel
    from pieper.perception.color_regions import read_regions
    from pieper.perception.pattern import load_patterns
    from pieper.yaml_file import Section, as_yaml, parse_yaml

FOLDER = Path(tempfile.mkdtemp())
PIECES = (
    b"", b"[", b"]", b"{", b"}", b": ", b"- ", b"\n", b"\n  ", b"&a ", b"*a", b"!!python/object:os.system", b"!!int", b"!!binary", b"---\n",
    b"...\n", b"'", b'"', b"|", b">", b"#", b"%YAML 1.2\n", b"\t", b"\x00", b"\xff", b"\xef\xbb\xbf", b".nan", b".inf", b"1e999", b"1:30",
    b"0x", b"0b", b"~", b"yes", b"2026-13-45", b"9" * 400, b"-1", b"[" * 40, b"<<: ", b"? ", b"\xe2\x80\xa8",
)  # fmt: skip
GOOD = (
    b"colors:\n  red: [[0, 1, 2, 3, 4], [9, 1, 2, 3, 4]]\n  blue: [[0, 1, 2, 3, 4]]\ndraw: {red: '#ff0000'}\n",
    as_yaml(
        {
            "format": "pieper colors 1",
            "space": "log-chroma",
            "threshold": 4.0,
            "colors": {"red": {"draw": "#ff0000", "mean": [4.0, 4.0, 5.4], "covariance": 0.01 * np.eye(3)}},
            "background": {"weights": [1.0], "means": [[4.0, 4.5, 4.0]], "covariances": [0.1 * np.eye(3)]},
            "learned": {"source": "a.mp4", "frames": [0, 9]},
        }
    ).encode(),
    b"camera:\n  size: [640, 480]\n  matrix: [[800, 0, 320], [0, 800, 240], [0, 0, 1]]\n  distortion: []\n",
    b"robots:\n- name: a\n  markers:\n  - {color: red, x_mm: 10, y_mm: 0, radius_mm: 20}\n  - {color: blue, x_mm: -10, y_mm: 0}\n",
)


def grown(provider: atheris.FuzzedDataProvider) -> bytes:
    """A good file with a few pieces wrong."""
    raw = bytearray(GOOD[provider.ConsumeIntInRange(0, len(GOOD) - 1)])
    for _ in range(provider.ConsumeIntInRange(1, 5)):
        at, length = provider.ConsumeIntInRange(0, len(raw)), provider.ConsumeIntInRange(0, 12)
        piece = PIECES[provider.ConsumeIntInRange(0, len(PIECES) - 1)]
        raw[at : at + length] = piece if provider.ConsumeBool() else provider.ConsumeBytes(4)
    return bytes(raw)


def touch(section: Section) -> None:
    """Call every reader on every field."""
    for key in list(section):
        for read in (section.text, section.boolean, section.integer, section.number, section.texts, section.sections):
            with suppress(PieperError):
                read(key)
        for shape in ((3,), (None, 5), (3, 3), (None, 3, 3)):
            with suppress(PieperError):
                section.array(key, shape)
        with suppress(PieperError):
            touch(section.section(key))
    section.plain(*section)


def one(data: bytes) -> None:
    """Read one input by every reader."""
    provider = atheris.FuzzedDataProvider(data)
    raw = grown(provider) if provider.ConsumeBool() else provider.ConsumeBytes(len(data))
    try:
        touch(parse_yaml(raw, "x.yaml"))
    except PieperError:
        return
    path = FOLDER / "x.yaml"
    path.write_bytes(raw)
    for read in (read_regions, load_camera, load_view, load_field_size, load_patterns):
        with suppress(PieperError, FileNotFoundError):  # a view may name the file of its camera
            read(path)
    try:
        model = ColorModel.load(path)
    except PieperError:
        return
    table = model.table(bits=4)
    model.save(FOLDER / "y.yaml")
    again = ColorModel.load(FOLDER / "y.yaml").table(bits=4)
    assert (again.labels != table.labels).mean() < 0.05, raw


def main() -> None:
    """Run libFuzzer."""
    np.seterr(all="ignore")
    atheris.Setup(sys.argv, one)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
