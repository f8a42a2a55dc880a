"""``pieper view``: a page to keep, an address with a token, and an end by Ctrl-C."""

from __future__ import annotations

import importlib.util
import os
import re
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request

import pytest

pytest.importorskip("viser", reason="the viewer's extra is not installed")

STARTING = 60.0  # [s] at most, on a busy machine


def test_a_page_to_keep(pieper_command, tmp_path):
    page = tmp_path / "mh12.html"
    result = pieper_command("view", "mh12", "--export", page, "--theme", "dark", "--frames", "--q", "0.1,0.2,0,0,0,0")
    assert result.code == 0, result.err
    assert re.search(r"wrote .*mh12\.html  \d\.\d MB", result.out.replace("\n", ""))
    assert "__VISER_EMBED_CONFIG__={darkMode:true}" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["mh12", "--theme", "pink"], "--theme must be light or dark, got 'pink'"),
        (["mh12", "--export", "page.png"], "--export writes a page, whose name ends in .html"),
        (["mh12", "--export", "no/such/folder/page.html"], "no/such/folder"),
        (["mh12", "--q", "9,0,0,0,0,0"], "outside its limits"),
        (["mh12", "--q", "nan,0,0,0,0,0"], "finite"),
        (["mh12", "--q", "1,2"], "needs as many values, got 2"),
        (["mh12", "--port", "70000"], "port must be a whole number from 0 to 65535, got 70000"),
        (["mh13"], "mh12"),
    ],
)
def test_what_makes_no_sense_is_told(pieper_command, options, said):
    result = pieper_command("view", *options)
    assert result.code == 2
    assert said in result.err


def test_a_motion_of_another_arm_is_told_with_its_file(pieper_command, tmp_path):
    file = tmp_path / "short.csv"
    file.write_text("t,joint_1_s\n0,0\n1,0.5\n")
    result = pieper_command("view", "mh12", "--trajectory", file, "--export", tmp_path / "page.html")
    assert result.code == 2
    assert "short.csv: the trajectory" in " ".join(result.err.split())


def test_a_taken_port_is_told(pieper_command):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        result = pieper_command("view", "mh12", "--no-browser", "--port", port)
    assert result.code == 2
    assert f"port {port} is taken; leave it out, or give another one" in result.err


def test_a_missing_extra_is_told(pieper_command, monkeypatch):
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: None if name == "viser" else found(name, *rest)
    )
    for name in [name for name in sys.modules if name in ("pieper.viewer.server", "pieper.viewer.view")]:
        monkeypatch.delitem(sys.modules, name)
    result = pieper_command("view", "mh12", "--no-browser")
    assert result.code == 3
    assert "viser is not installed; the viewer in the browser needs it: pip install 'pieper[viewer]'" in result.err


@pytest.mark.skipif(os.name == "nt", reason="Windows has other signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_prints_its_address_and_ends_when_asked(number):
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    process = subprocess.Popen(
        [sys.executable, "-m", "pieper", "view", "ur5e", "--port", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )
    try:
        lines = [process.stdout.readline() for _ in range(2)]
        url = re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", "".join(lines))[0]
        with urllib.request.urlopen(url, timeout=STARTING) as answer:
            assert answer.status == 200
        with pytest.raises(urllib.error.HTTPError, match="403") as refused:
            urllib.request.urlopen(url.partition("?")[0], timeout=STARTING)
        refused.value.close()
        process.send_signal(number)
        _, complaint = process.communicate(timeout=STARTING)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == 0, complaint
    assert complaint == ""
