"""The public functions say what they take, give back and refuse: arrays with their shapes, errors by their names.

Public is what docs/concepts.md names, without the underscored. The sources are read, not imported, so that no extra is needed.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "pieper"
NAMED = re.compile(r"`pieper\.([a-z0-9_.]+)`")
SECTION = re.compile(r"^([A-Z][a-z]+(?: [A-Z][a-z]+)?)\n-{3,}\n", re.MULTILINE)
ENTRY = re.compile(r"^(\S[^\n]*)$", re.MULTILINE)
ARRAY = re.compile(r"ArrayLike|FloatArray|NDArray|ndarray")
AXIS = r"(?:\.\.\.|[A-Za-z0-9+* -]+)"
SHAPE = re.compile(rf"\({AXIS}(?:, ?{AXIS})*,?\)|\(\)")  # (), (...), (6,), (..., n), (m, 2 n + 1)
OURS = set(re.findall(r"^class (\w+Error)\b", (SOURCE / "errors.py").read_text(encoding="utf-8"), re.MULTILINE))
REFERENCE = re.compile(r"`~?(?:pieper\.)?\w+(?:\.\w+)*`")


class Function(NamedTuple):
    """A public function or method and its docstring, taken apart."""

    name: str
    node: ast.FunctionDef | ast.AsyncFunctionDef
    is_method: bool
    summary: str
    sections: dict[str, str]

    @property
    def doc(self) -> str:
        return ast.get_docstring(self.node) or ""

    @property
    def parameters(self) -> dict[str, str]:
        """Names without self, and their annotations."""
        given = self.node.args
        listed = [*given.posonlyargs, *given.args, *given.kwonlyargs]
        return {
            a.arg: ast.unparse(a.annotation) if a.annotation else "" for a in listed if a.arg not in ("self", "cls")
        }

    @property
    def result(self) -> str:
        return ast.unparse(self.node.returns) if self.node.returns else "None"

    @property
    def is_property(self) -> bool:
        return any(re.search(r"property$|\.setter$", ast.unparse(d)) for d in self.node.decorator_list)

    @property
    def described(self) -> dict[str, str]:
        """Names in the section of parameters, and what is said of their types."""
        entries = [line.partition(" : ") for line in ENTRY.findall(self.sections.get("Parameters", ""))]
        return {name.strip().lstrip("*"): kind for names, _, kind in entries for name in names.split(",")}

    @property
    def raised(self) -> set[str]:
        """The package's errors that the function itself raises."""
        raises = [node.exc for node in ast.walk(self.node) if isinstance(node, ast.Raise) and node.exc is not None]
        names = {ast.unparse(error.func if isinstance(error, ast.Call) else error) for error in raises}
        return names & OURS


def public_modules() -> list[str]:
    """Dotted names below pieper of the modules that the page of concepts names, and of the facade."""
    found = {"arm", "errors"}
    for name in NAMED.findall((ROOT / "docs" / "concepts.md").read_text(encoding="utf-8")):
        path = SOURCE.joinpath(*name.split("."))
        if path.with_suffix(".py").is_file():
            found.add(name)
    return sorted(found)


def functions_of(module: str) -> list[Function]:
    """The public functions of a module, and the public methods of its public classes; those that it lists from elsewhere too."""
    body = tree(module).body
    found = list(walk(body, module, in_class=False))
    for node in body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("pieper."):
            home = str(node.module).removeprefix("pieper.")
            taken = {alias.name for alias in node.names} & exported(body)
            if taken:
                there = [n for n in tree(home).body if getattr(n, "name", None) in taken]
                found += walk(there, home, in_class=False)
    return found


def tree(module: str) -> ast.Module:
    path = SOURCE.joinpath(*module.split(".")).with_suffix(".py")
    return ast.parse(path.read_text(encoding="utf-8"))


def exported(body: list[ast.stmt]) -> set[str]:
    """The names in ``__all__``; none where there is no such list."""
    lists = [n.value for n in body if isinstance(n, ast.Assign) and ast.unparse(n.targets[0]) == "__all__"]
    return {name for names in lists for name in ast.literal_eval(names)}


def walk(body: list[ast.stmt], prefix: str, *, in_class: bool):
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from walk(node.body, f"{prefix}.{node.name}", in_class=True)
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) and not node.name.startswith("_"):
            summary, *rest = SECTION.split(ast.get_docstring(node) or "")
            sections = dict(zip(rest[::2], rest[1::2], strict=True))
            yield Function(f"pieper.{prefix}.{node.name}", node, in_class, summary, sections)


def gaps(function: Function) -> list[str]:
    """What the docstring of a function lacks, in words."""
    found = []
    parameters, sections = function.parameters, function.sections
    if not function.doc:
        return ["has no docstring"]
    if "Parameters" in sections:
        if unknown := [name for name in parameters if name not in function.described]:
            found.append(f"does not describe {', '.join(unknown)}")
        if function.result != "None" and not {"Returns", "Yields"} & set(sections):
            found.append(f"does not say what it returns, {function.result}")
    elif len(parameters) >= 3 and not function.is_method and not REFERENCE.search(function.doc):
        found.append(f"takes {', '.join(parameters)}, and describes none of them")
    arrays = [name for name, kind in parameters.items() if ARRAY.search(re.sub(r"Mapping\[.*\]", "", kind))]
    if arrays and not SHAPE.search(function.doc):
        found.append(f"does not say what shape {', '.join(arrays)} must have")
    gives = function.summary + sections.get("Returns", "") + sections.get("Yields", "")
    if ARRAY.search(function.result) and not SHAPE.search(gives):
        found.append("does not say what shape it returns")
    if misplaced := [
        title for title, text in sections.items() if title != "Examples" and re.search("^>>>", text, re.M)
    ]:
        found.append(f"has an example under {misplaced[0]}")
    if silent := sorted(name for name in function.raised if name not in function.doc):
        found.append(f"raises {', '.join(silent)} without saying so")
    return found


@pytest.mark.parametrize("module", public_modules())
def test_public_functions_say_what_they_take_and_give(module):
    lacking = [f"{f.name} (line {f.node.lineno}) {gap}" for f in functions_of(module) for gap in gaps(f)]
    assert not lacking, "\n".join(lacking)


SILENT = '''
def move(q: ArrayLike, T: ArrayLike, speed: float, *, out: FloatArray | None = None) -> FloatArray:
    """Move there."""
    raise ArrayError(f"q must have shape (6,), got {q}")
'''
TELLING = '''
def move(q: ArrayLike, *, speed: float = 1.0) -> FloatArray:
    """Move there.

    Parameters
    ----------
    q : (..., n) array_like
        Joint values [rad or m].
    speed : float
        [rad/s]

    Returns
    -------
    (..., 4, 4) array

    Raises
    ------
    ArrayError
        Another shape.
    """
    raise ArrayError(f"q must have shape (6,), got {q}")
'''


def test_what_a_module_lists_from_elsewhere_is_read_there():
    names = {function.name for function in functions_of("model.dh")}
    assert "pieper.model.dh.forward_kinematics" in names  # its own
    assert any(name.endswith(".standard_dh") for name in names)
    assert not exported(tree("model.poe").body)


def test_a_silent_docstring_is_found():
    [silent] = walk(ast.parse(SILENT).body, "x", in_class=False)
    assert gaps(silent) == [
        "takes q, T, speed, out, and describes none of them",
        "does not say what shape q, T, out must have",
        "does not say what shape it returns",
        "raises ArrayError without saying so",
    ]
    [telling] = walk(ast.parse(TELLING).body, "x", in_class=False)
    assert gaps(telling) == []
    [shown] = walk(
        ast.parse(TELLING.replace("Another shape.\n", "Another shape.\n\n    >>> 1\n    1\n")).body, "x", in_class=False
    )
    assert gaps(shown) == ["has an example under Raises"]
    half = TELLING.replace("    speed : float\n        [rad/s]\n", "").replace("(..., 4, 4) array", "array")
    [half] = walk(ast.parse(half.replace("ArrayError\n        Another shape.", "")).body, "x", in_class=False)
    assert gaps(half) == [
        "does not describe speed",
        "does not say what shape it returns",
        "raises ArrayError without saying so",
    ]
