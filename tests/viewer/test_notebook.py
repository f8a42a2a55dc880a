"""An arm shows itself in a notebook: what the formatter gives, what is in it, and what an outsider's names cannot do."""

import re
import subprocess
import sys
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import pieper
from pieper.errors import ArrayError
from pieper.model.chain import Chain
from pieper.viewer import notebook
from tests.robots import NAMES

LIGHT_WEIGHT = 60_000  # characters of a notebook file for each arm that is shown
SVG = "{http://www.w3.org/2000/svg}"


def picture(arm, **options) -> ET.Element:
    return ET.fromstring(notebook.svg(arm, **options))


def points(element: ET.Element) -> np.ndarray:
    return np.array([[float(x), float(y)] for x, y in re.findall(r"(-?[\d.]+) (-?[\d.]+)", element.attrib["d"])])


@pytest.mark.parametrize("name", NAMES)
def test_every_robot_has_a_light_picture_with_joints_and_limits(name):
    arm = pieper.load(name)
    text = notebook.html(arm)
    assert len(text) < LIGHT_WEIGHT
    page = ET.fromstring(text)  # well formed
    rows = ["".join(row.itertext()) for row in page.iter("tr")]
    assert len(rows) == arm.dof + 1
    for row, joint, (lower, _) in zip(rows[1:], arm.joint_names, arm.limits, strict=True):
        said = f"{lower + 0.0:.3f} rad".replace("-", "\N{MINUS SIGN}") if np.isfinite(lower) else "\N{EN DASH}"
        assert row.startswith(joint + said)
    assert f"{arm.dof} joints, {arm.base} \N{RIGHTWARDS ARROW} {arm.tip}, reach " in text
    drawn = next(page.iter(f"{SVG}svg"))
    width, height = (float(drawn.attrib[side]) for side in ("width", "height"))
    everything = np.vstack([points(path) for path in drawn.iter(f"{SVG}path")])
    assert (everything >= 0.0).all()
    assert (everything <= [width, height]).all()
    assert np.ptp(everything, axis=0).max() > 0.8 * max(width, height)


def test_the_picture_follows_the_joints():
    arm = pieper.load("ur5e")
    bent, straight = (notebook.svg(arm, q) for q in ([0, -1, 1, 0, 1, 0], [0, -np.pi / 2, 0, 0, 0, 0]))
    assert bent != straight
    sizes = [[float(ET.fromstring(text).attrib[side]) for side in ("width", "height")] for text in (bent, straight)]
    assert sizes[1][1] > 2.0 * sizes[1][0]  # straight up
    assert sizes[0][0] > sizes[0][1]
    title = picture(arm, q=[0, -1, 1, 0, 1, 0]).find(f"{SVG}title")
    assert title is not None
    assert title.text == "ur5e at q = (0.00, -1.00, 1.00, 0.00, 1.00, 0.00)"


def test_what_is_nearer_is_drawn_later():
    # two posts, one behind the other as seen: the one that is nearer hides the other, whichever comes first in the chain
    for near in (0, 1):
        offsets = [np.array([0.6, -0.85, 0.0]) * (1.0 if k == near else -1.0) for k in range(2)]
        solids = []
        for offset in offsets:
            T = np.eye(4)
            T[:3, 3] = offset
            part = notebook_part(0.2, 1.0)
            solids.append(notebook._seen(part, notebook._view() @ T))
        assert notebook._back_to_front(solids)[-1] == near


def notebook_part(radius: float, length: float):
    from pieper.model.shape import Drum, Part

    return Part(0, "link", Drum(radius, length, 0.02), np.eye(4))


def test_sliding_joints_are_in_metres_and_endless_ones_have_no_limit():
    slide, turn = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    home = np.eye(4)
    home[0, 3] = 0.4
    arm = pieper.Arm(Chain("lift", [slide, turn], home, [[0.0, 1.5], [-np.inf, np.inf]], ("lift", "turn")))
    lift, turned = ("".join(row.itertext()) for row in list(ET.fromstring(notebook.html(arm)).iter("tr"))[1:])
    assert lift.startswith("lift0.000 m1.500 m")
    assert turned == "turn" + 5 * "\N{EN DASH}"
    endless = pieper.Arm(Chain("rail", [slide], home, [[-np.inf, np.inf]], ("rail",)))
    assert "no end of reach" in notebook.html(endless)
    assert "1 joint," in notebook.html(endless)


def test_an_arm_without_joints_is_shown_too():
    home = np.eye(4)
    home[2, 3] = 0.5
    text = notebook.html(pieper.Arm(Chain("post", np.empty((0, 6)), home, np.empty((0, 2)), ())))
    assert "0 joints" in text
    assert "reach 0.500 m" in text


def test_names_from_a_description_stay_text():
    evil = '<script>alert("x")</script>'
    home = np.eye(4)
    home[0, 3] = 0.5
    chain = Chain(evil, [[0, 0, 0, 0, 0, 1]], home, [[-1, 1]], (f"{evil}&",), base="<b>", tip="</div><img src=x>")
    text = notebook.html(pieper.Arm(chain))
    tags = {element.tag.rpartition("}")[2] for element in ET.fromstring(text).iter()}
    assert tags <= {"div", "b", "table", "tr", "th", "td", "svg", "title", "path"}
    assert "<script" not in text
    assert "<img" not in text


def test_nothing_is_fetched_and_nothing_runs():
    text = notebook.html(pieper.load("mh12")).replace("http://www.w3.org/2000/svg", "")
    assert not re.search(r"https?:|url\(|href|src=|<script|<style| on\w+=| id=", text)


def test_bad_joint_values():
    with pytest.raises(ArrayError, match="finite"):
        notebook.svg(pieper.load("ur5e"), [np.nan] * 6)
    with pytest.raises(ArrayError, match="6"):
        notebook.svg(pieper.load("ur5e"), [0.0] * 5)


# --- IPython

IN_IPYTHON = """
from IPython.core.interactiveshell import InteractiveShell
shell = InteractiveShell.instance(colors="nocolor")
result = shell.run_cell("import pieper\\narm = pieper.load('ur5e')\\narm", store_history=False)
shown, _ = shell.display_formatter.format(result.result)
assert shown["text/plain"] == repr(result.result), shown
assert shown["text/html"].startswith("<div"), shown
assert "wrist_3_joint" in shown["text/html"]
assert "matplotlib" not in __import__("sys").modules
print("shown")
"""


def run(code: str, *options: str) -> str:
    result = subprocess.run(
        [sys.executable, *options, "-c", code], capture_output=True, text=True, timeout=120, check=False
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_ipython_shows_an_arm(tmp_path, monkeypatch):
    pytest.importorskip("IPython", reason="IPython is not installed")
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    assert run(IN_IPYTHON).splitlines()[-1] == "shown"


def test_import_costs_nothing_without_ipython():
    code = (
        "import sys, pieper; print(*sorted(m for m in sys.modules if m.startswith(('IPython', 'numpy', 'pieper.v'))))"
    )
    assert run(code, "-W", "error").strip() == ""


def test_ipython_that_is_merely_imported_does_no_harm(tmp_path, monkeypatch):
    pytest.importorskip("IPython", reason="IPython is not installed")
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    assert run("import IPython, pieper; print(pieper.load('ur5e'))").startswith("Arm('ur5e'")
