"""A store is refused with the reason when it is damaged, of something else, or answers another question."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pieper._native import kernels
from pieper.errors import MapError
from pieper.workspace import store as stores
from pieper.workspace.run import run
from pieper.workspace.survey import Survey, survey
from tests.robots import chain

zarr = pytest.importorskip("zarr", reason="zarr is not installed: the extra 'maps'")

BOX = [[0.2, -0.2, 0.2], [0.6, 0.2, 0.6]]


def asked(**options: object) -> Survey:
    return survey(chain("ur5e"), **{"voxel": 0.1, "orientations": 10, "box": BOX, "chunk": 3, **options})  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("maps") / "map.zarr"
    run(asked(), stores.create(place, asked()))
    return place


@pytest.fixture
def place(whole: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole, tmp_path / "map.zarr"))


def test_a_store_holds_the_question_and_opens_with_zarr_alone(place: Path) -> None:
    group = zarr.open_group(str(place), mode="r")
    record = group.attrs["record"]
    assert isinstance(record, dict)
    expected = {"arm": "ur5e", "voxel": 0.1, "samples": 10, "seed": 0}
    assert {key: record[key] for key in expected} == expected
    assert record["limits"] == chain("ur5e").limits.tolist()
    assert "version" in record
    reached = group["reached"]
    assert reached.shape == (5, 5, 5)  # type: ignore[union-attr]
    assert np.asarray(reached[:]).max() == 10  # type: ignore[index]
    found = stores.open_store(place).map()
    assert np.array_equal(found.array("dexterity") * 10, np.asarray(reached[:]))  # type: ignore[index]


def test_a_store_that_is_there_is_not_overwritten(place: Path) -> None:
    with pytest.raises(MapError, match="is there already; go on with it with --resume, remove it, or name another"):
        stores.create(place, asked())


def test_the_folder_of_a_store_has_to_be_there(tmp_path: Path) -> None:
    with pytest.raises(MapError, match=r"no such folder: .*nowhere"):
        stores.create(tmp_path / "nowhere" / "map.zarr", asked())


def test_a_folder_that_cannot_be_written_to_is_named() -> None:
    with pytest.raises(OSError, match=r"/proc/map\.zarr") as caught:
        stores.create("/proc/map.zarr", asked())
    assert caught.value.filename == "/proc/map.zarr"


@pytest.mark.parametrize(
    ("options", "difference"),
    [
        ({"orientations": 12}, "samples is 10 there and 12 here"),
        ({"seed": 1}, "seed is 0 there and 1 here"),
        ({"voxel": 0.2}, "voxel is 0.1 there and 0.2 here"),
    ],
)
def test_a_store_of_another_question_is_refused(place: Path, options: dict[str, object], difference: str) -> None:
    with pytest.raises(MapError, match=f"belongs to another question: .*{difference}"):
        stores.resume(place, asked(**options))


def test_a_store_of_another_arm_is_refused(place: Path) -> None:
    other = survey(chain("ur5"), voxel=0.1, orientations=10, box=BOX, chunk=3)
    with pytest.raises(MapError, match="arm is 'ur5e' there and 'ur5' here"):
        stores.resume(place, other)


def _change_attributes(change: Callable[[dict], None]) -> Callable[[Path], None]:  # type: ignore[type-arg]
    def spoil(place: Path) -> None:
        file = place / "zarr.json"
        content = json.loads(file.read_text())
        change(content["attributes"])
        file.write_text(json.dumps(content))

    return spoil


def _cut_a_chunk(place: Path) -> None:
    file = place / "manipulability" / "c" / "0" / "1" / "0"
    file.write_bytes(file.read_bytes()[:-7])


def _flip_a_bit(place: Path) -> None:
    file = place / "reached" / "c" / "1" / "1" / "1"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(bytes(content))


def _another_shape(place: Path) -> None:
    shutil.rmtree(place / "solutions")
    zarr.open_group(str(place), mode="r+").create_array("solutions", shape=(2, 2, 2), dtype="u4")


SPOILED: dict[str, tuple[Callable[[Path], None], str]] = {
    "a cut chunk": (
        _cut_a_chunk,
        r"damaged: a chunk of 'manipulability' within voxels \[0:3, 3:5, 0:3\] cannot be read",
    ),
    "a flipped bit": (_flip_a_bit, r"damaged: a chunk of 'reached' within voxels \[3:5, 3:5, 3:5\] cannot be read"),
    "no zarr.json": (
        lambda place: (place / "zarr.json").unlink(),
        "is no zarr store of version 3: it holds no zarr.json",
    ),
    "a zarr.json of nothing": (lambda place: (place / "zarr.json").write_text("{"), "zarr.json cannot be read"),
    "another format": (_change_attributes(dict.clear), "but no map made by pieper workspace: its format is None"),
    "a later version": (
        _change_attributes(lambda attributes: attributes.update(format_version=2)),
        "has version 2 of the format; this pieper reads version 1",
    ),
    "no record": (
        _change_attributes(lambda attributes: attributes.pop("record")),
        "the record of the question is damaged",
    ),
    "a record of no voxels": (
        _change_attributes(lambda attributes: attributes["record"].update(shape=[0, 1, 1])),
        "the record of the question is damaged",
    ),
    "an array that is gone": (
        lambda place: shutil.rmtree(place / "limit_margin"),
        "the array 'limit_margin' is missing",
    ),
    "an array of another shape": (
        _another_shape,
        r"the array 'solutions' does not fit the record: expected shape \(5, 5, 5\)",
    ),
}


@pytest.mark.parametrize("what", SPOILED)
def test_a_damaged_store_is_refused_with_the_reason(place: Path, what: str) -> None:
    spoil, message = SPOILED[what]
    spoil(place)
    with pytest.raises(MapError, match=message):
        stores.resume(place, asked())


def test_a_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="is not there"):
        stores.open_store(tmp_path / "map.zarr")
    (tmp_path / "letters").mkdir()
    with pytest.raises(MapError, match="is no zarr store of version 3"):
        stores.open_store(tmp_path / "letters")
    zarr.create_group(str(tmp_path / "pictures.zarr"))
    with pytest.raises(MapError, match="no map made by pieper workspace"):
        stores.open_store(tmp_path / "pictures.zarr")


def test_a_map_that_was_begun_with_other_instructions_goes_on_with_them(tmp_path: Path) -> None:
    other = kernels.instruction_sets()[0]
    before = kernels.instruction_set()
    place = tmp_path / "map.zarr"
    try:
        run(asked(), stores.create(place, replace(asked(), instructions=other)), stop=lambda: True)
        assert stores.like(place, asked()).instructions == other
        stores.resume(place, stores.like(place, asked()))
        if other != before:
            with pytest.raises(MapError, match=f"instructions is '{other}' there and '{before}' here"):
                stores.resume(place, asked())
    finally:
        kernels.use_instruction_set(before)


def test_a_chunk_whose_file_is_removed_is_computed_again(place: Path) -> None:
    before = stores.open_store(place).map().array("manipulability").tobytes()
    (place / "reached" / "c" / "0" / "0" / "0").unlink()
    kept = stores.resume(place, asked())
    assert kept.map().missing == {0}
    assert run(asked(), kept).array("manipulability").tobytes() == before


def test_files_that_are_no_chunks_are_passed_over(place: Path) -> None:
    folder = place / "reached" / "c" / "0" / "0"
    (folder / "0.1234.partial").write_bytes(b"half")
    (place / "reached" / "c" / "77" / "0").mkdir(parents=True)
    (place / "reached" / "c" / "77" / "0" / "0").write_bytes(b"of another grid")
    assert stores.open_store(place).finished() == set(range(8))
