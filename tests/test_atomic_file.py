"""Files are written whole or not at all: on a full disk, when killed, through links, into what is no file."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import threading

import pytest

from pieper.atomic_file import replacing, write_bytes, write_text

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="links, modes, limits and devices of Unix")


def names(folder) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_written_and_written_over(tmp_path):
    file = tmp_path / "a.txt"
    write_text(file, "grün\n")
    assert file.read_bytes() == "grün\n".encode()
    write_bytes(str(file), b"new")
    assert file.read_bytes() == b"new"
    assert names(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("fault", [KeyboardInterrupt, ValueError, OSError(28, "No space left on device")])
def test_an_interrupted_write_leaves_the_old_file(tmp_path, fault):
    file = tmp_path / "move.csv"
    file.write_text("old")

    def interrupted() -> None:
        with replacing(file) as unfinished:
            assert unfinished.suffix == ".csv"
            unfinished.write_text("new, but")
            raise fault

    with pytest.raises(fault if isinstance(fault, type) else OSError):
        interrupted()
    assert [path.read_text() for path in tmp_path.iterdir()] == ["old"]


def test_a_full_disk_is_told_with_the_name_that_was_asked_for(tmp_path):
    file = tmp_path / "arm.png"
    with pytest.raises(OSError, match="No space left") as told, replacing(file):
        raise OSError(28, "No space left on device")
    assert told.value.filename == str(file)
    assert not names(tmp_path)


def test_nothing_gets_its_name_before_it_is_on_the_disk(tmp_path, monkeypatch):
    file = tmp_path / "a"
    file.write_text("old")

    def fail(_):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OSError, match="Input/output error") as told:
        write_text(file, "new")
    assert told.value.filename == str(file)
    assert (file.read_text(), names(tmp_path)) == ("old", ["a"])


@POSIX
def test_a_disk_that_fills_up_in_the_middle(tmp_path):
    """A limit on the size of files stops the write in its middle, as a full disk does."""
    file = tmp_path / "big"
    file.write_text("old")
    code = (
        "import resource, sys; from pieper.atomic_file import write_bytes;"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096)); write_bytes(sys.argv[1], bytes(10**6))"
    )
    done = subprocess.run([sys.executable, "-c", code, str(file)], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert f"File too large: '{file}'" in done.stderr
    assert (file.read_text(), names(tmp_path)) == ("old", ["big"])


@POSIX
def test_killed_in_the_middle(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("old")
    code = (
        "import os, sys; from pieper.atomic_file import replacing\n"
        "with replacing(sys.argv[1]) as unfinished:\n"
        "    unfinished.write_text('half of')\n"
        "    os.kill(os.getpid(), 9)\n"
    )
    assert subprocess.run([sys.executable, "-c", code, str(file)], check=False).returncode == -9
    assert file.read_text() == "old"
    write_text(file, "new")  # what the killed one left is in nobody's way
    assert file.read_text() == "new"


@POSIX
def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    real = tmp_path / "elsewhere" / "real.txt"
    real.write_text("old")
    link, dangling = tmp_path / "link.txt", tmp_path / "dangling"
    link.symlink_to(real)
    dangling.symlink_to(tmp_path / "elsewhere" / "made")
    write_text(link, "new")
    write_text(dangling, "made")
    assert link.is_symlink()
    assert (real.read_text(), (tmp_path / "elsewhere" / "made").read_text()) == ("new", "made")


@POSIX
def test_permissions_are_kept_and_new_files_get_the_usual_ones(tmp_path):
    file, new, usual = tmp_path / "a", tmp_path / "b", tmp_path / "c"
    file.write_text("old")
    file.chmod(0o640)
    for path in (file, new):
        write_text(path, "new")
    usual.write_text("")
    assert stat.S_IMODE(file.stat().st_mode) == 0o640
    assert stat.S_IMODE(new.stat().st_mode) == stat.S_IMODE(usual.stat().st_mode)


@POSIX
def test_a_pipe_is_written_to_and_stays_a_pipe(tmp_path):
    pipe = tmp_path / "pipe.json"
    os.mkfifo(pipe)
    heard: list[str] = []
    reader = threading.Thread(target=lambda: heard.append(pipe.read_text()))
    reader.start()
    write_text(pipe, "through")
    reader.join(timeout=20.0)
    assert heard == ["through"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device that is always full")  # noqa: PTH110
def test_a_device_that_is_full():
    with pytest.raises(OSError, match="No space left") as told:
        write_text("/dev/full", "x" * 100)
    assert told.value.filename == "/dev/full"


def test_where_nothing_can_be_written(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such folder") as told:
        write_text(tmp_path / "nowhere" / "a", "x")
    assert told.value.filename == str(tmp_path / "nowhere")
    with pytest.raises(IsADirectoryError, match="is a folder, not a file"):
        write_text(tmp_path, "x")


@POSIX
@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_may_not_be_written(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(PermissionError) as told:
        write_text(tmp_path / "a", "x")
    assert told.value.filename == str(tmp_path / "a")


def test_a_folder_that_refuses_is_told_with_the_name_that_was_asked_for(tmp_path, monkeypatch):
    def refuse(self, *_, **__):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr("pathlib.Path.write_bytes", refuse)
    with pytest.raises(PermissionError, match="Permission denied") as told:
        write_text(tmp_path / "a", "x")
    assert told.value.filename == str(tmp_path / "a")


def test_a_name_as_long_as_names_may_be(tmp_path):
    file = tmp_path / ("n" * 251 + ".txt")
    write_text(file, "fits")
    assert file.read_text() == "fits"
