"""What ``--json`` prints is what the schema says, verb by verb; the page about it is made from the schema."""

from __future__ import annotations

import importlib.util
import json
import shlex
from pathlib import Path
from typing import Any

import pytest

from pieper.cli import doctor
from pieper.cli.main import main
from pieper.perception import pass_marks
from tests.cli.kitchen import Kitchen, verbs

ROOT = Path(__file__).parents[2]
SCHEMA = json.loads((ROOT / "docs" / "guides" / "json_output.json").read_text(encoding="utf-8"))
FORMS = SCHEMA["$defs"]
KINDS = {
    "object": dict, "array": list, "string": str, "boolean": bool, "integer": int, "number": (int, float), "null": type(None),
}  # fmt: skip
WORDS = {
    "type", "properties", "required", "additionalProperties", "items", "enum", "description", "unit", "shape", "$ref"
}  # fmt: skip


def faults(value: Any, form: dict[str, Any], sizes: dict[str, int], place: str = "") -> list[str]:
    """Where a value is not as a form says; `sizes` keeps the lengths that letters stand for."""
    assert set(form) <= WORDS, f"{place}: this test knows nothing of {set(form) - WORDS}"
    if "$ref" in form:
        return faults(value, FORMS[form["$ref"].removeprefix("#/$defs/")], sizes, place)
    kinds = form["type"] if isinstance(form["type"], list) else [form["type"]]
    if not any(isinstance(value, KINDS[kind]) and (kind == "boolean" or value is not True) for kind in kinds):
        return [f"{place} is {value!r}, and not {' or '.join(kinds)}"]
    found = []
    if "enum" in form and value not in form["enum"]:
        found.append(f"{place} is {value!r}, and none of {form['enum']}")
    if isinstance(value, dict) and "properties" in form:
        found += [f"{place} has no {key}" for key in form["required"] if key not in value]
        found += [f"{place}.{key} is not in the schema" for key in value if key not in form["properties"]]
        for key, part in form["properties"].items():
            if key in value:
                found += faults(value[key], part, sizes, f"{place}.{key}")
    if isinstance(value, list):
        found += wrong_shape(value, form.get("shape", []), sizes, place)
        for part in value:
            found += faults(part, form["items"], sizes, f"{place}[]")
    return found


def wrong_shape(value: Any, shape: list[int | str], sizes: dict[str, int], place: str) -> list[str]:
    if not shape:
        return []
    length, wanted = len(value), shape[0]
    if wanted == "n or 0":
        wanted = "n" if length else 0
    if wanted != "any" and length != (wanted if isinstance(wanted, int) else sizes.setdefault(wanted, length)):
        return [f"{place} has {length} elements, and not {wanted} = {sizes.get(str(wanted), wanted)}"]
    return [fault for part in value for fault in wrong_shape(part, shape[1:], sizes, place)]


FAR = "3 0 0"
LINES = {
    "robots": ["robots"],
    "info": ["info ur5e", "info panda", "info youbot"],
    "fk": ["fk ur5e 0 -1 1 0 0 0", "fk mh12 --deg 1 2 3 --tip link_3_u", "fk ur5e 0 0 0 0 0 0 --up-to forearm_link"],
    "ik": ["ik ur5e 0.4 0.2 0.3 --rpy 3 0 0", "ik panda 0.4 0 0.5", f"ik ur5e {FAR}", "ik mh12 0.3 0.3 0.3 --axis 0 0 1"],
    "reach": ["reach mh12 0.3 0.3 0.3", f"reach ur5e {FAR} --quat 0 0 0 1"],
    "convert --to dh, mdh or hayati": [f"convert ur5e --to {form}" for form in ("dh", "mdh", "hayati")],
    "convert --to screws": ["convert panda --to screws"],
    "convert, other forms": [f"convert youbot --to {form}" for form in ("urdf", "latex", "c", "python")],
    "move": [
        "move ur5e --to 0.1,-1,1,0,0,0",
        "move ur5e --from 0,-1,1,-1,-1,0 --target 0.5 0.2 0.4 --straight --rate 20",
        "move ur5e --from 0,-1,1,-1,-1,0 --target 5 0.2 0.4 --straight",
        "move ur5e --target 5 0 0",
    ],
    "plan": ["plan ur5e --to 0,-1.2,1.2,-1.6,-1.6,0", "plan ur5e --world world.yaml --target 0.55 0 0.4 --timeout 0.2"],
    "workspace": ["workspace ur5e --voxel 0.3 --orientations 10", "workspace ur5e --slice z=-0.7 --voxel 0.3 --orientations 10 --counts-only"],
    "place": ["place ur3e ur5e task.csv --step 0.3", "place ur3e task.csv --x 5 5 --y 5 5"],
    "calibrate-arm": ["calibrate-arm ur5e measured.csv --hold-out 0.2 --add 2", "calibrate-arm ur5e measured.csv --free offsets"],
    "synthesize": ["synthesize clean --count 2 --size 64x64 --out small"],
    "synthesize --list": ["synthesize --list"],
    "evaluate": ["evaluate tracks.csv clean/truth.jsonl"],
    "evaluate --marks": ["evaluate --marks"],
    "doctor": ["doctor"],
    "an error, on standard error": ["fk mh13 0", "fk mh12 0 0", "info", "move ur5e", "convert ur5e --to nothing"],
}  # fmt: skip
NEEDS = {
    "move": "ruckig", "plan": "ompl", "workspace": "skimage", "synthesize": "cv2", "evaluate": "cv2",
}  # fmt: skip


@pytest.fixture(scope="module")
def kitchen(tmp_path_factory: pytest.TempPathFactory) -> Kitchen:
    return Kitchen(tmp_path_factory.mktemp("kitchen"))


@pytest.mark.parametrize("form", FORMS)
def test_the_output_is_as_the_schema_says(
    form: str, kitchen: Kitchen, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    if needed := NEEDS.get(form.split(" ")[0]):
        pytest.importorskip(needed, reason=f"{needed} is not installed")
    monkeypatch.chdir(tmp_path)
    if form == "doctor":
        monkeypatch.setattr(doctor, "EXTRAS", {"symbolic": doctor.EXTRAS["symbolic"]})
        monkeypatch.setattr(doctor, "PROBES", {"core": doctor.PROBES["core"]})
    if (
        form == "evaluate --marks"
    ):  # which takes minutes; what is printed of marks is here the same for two that are made up
        mark = pass_marks.Mark(what="what", unit="m", ours=0.1, report=None, limit=0.2)
        monkeypatch.setattr(pass_marks, "measure", lambda **_: [mark, mark])
    for line in LINES[form]:
        words = shlex.split(line)
        kitchen.lay(["pieper", *words], words[0])
        capsys.readouterr()
        code = main([*words, "--json"])
        said = capsys.readouterr()
        if form.startswith("an error"):
            assert code == 2
            assert said.out == ""
            answer = json.loads(said.err.splitlines()[-1])
            assert answer["exit_code"] == code
        else:
            assert code in (0, 1), said.err
            answer = json.loads(said.out)
        assert faults(answer, FORMS[form], {}) == [], line


def test_every_verb_that_prints_json_has_a_schema() -> None:
    printing = {verb for verb, command in verbs().items() if any("--json" in param.opts for param in command.params)}
    assert {form.split(" ")[0].rstrip(",") for form in FORMS if not form.startswith("an ")} == printing
    assert set(LINES) == set(FORMS)


def test_a_schema_says_of_everything_what_it_is() -> None:
    def look(form: dict[str, Any], place: str) -> None:
        assert form.get("description") or "$ref" in form or "[]" in place, place
        assert set(form.get("required", ())) == set(form.get("properties", ())), place
        for key, part in form.get("properties", {}).items():
            look(part, f"{place}.{key}")
        if "items" in form:
            look(form["items"], f"{place}[]")

    for name, form in FORMS.items():
        look(form, name)


@pytest.mark.parametrize(
    ("value", "fault"),
    [
        ({"q": [1.0, 2.0], "m": [[1.0, 2.0]]}, ""),
        ({"q": [1.0, 2.0]}, "has no m"),
        ({"q": [1.0, 2.0], "m": [[1.0]]}, "has 1 elements, and not n = 2"),
        ({"q": [1.0, "2"], "m": []}, "is '2', and not number"),
        ({"q": [True], "m": []}, "is True, and not number"),
        ({"q": [], "m": [], "more": 1}, ".more is not in the schema"),
    ],
)
def test_a_fault_is_found(value: Any, fault: str) -> None:
    numbers = {"type": "array", "items": {"type": "number"}, "shape": ["n"]}
    rows = {"type": "array", "items": {"type": "array", "items": {"type": "number"}}, "shape": ["any", "n"]}
    form = {"type": "object", "properties": {"q": numbers, "m": rows}, "required": ["q", "m"]}
    found = faults(value, form, {})
    assert (fault in found[0]) if fault else found == []


def test_the_page_is_made_from_the_schema() -> None:
    source = importlib.util.spec_from_file_location("json_page", ROOT / "scripts" / "json_page.py")
    assert source is not None
    assert source.loader is not None
    module = importlib.util.module_from_spec(source)
    source.loader.exec_module(module)
    assert module.PAGE.read_text(encoding="utf-8") == module.page(), "run scripts/json_page.py"
