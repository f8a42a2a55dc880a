"""The public names of every room are those on a checked-in list, with the names, the kinds and the defaults of their parameters.

A name is public where it is in its module's ``__all__``, or, in a module without one, defined there and not underscored; so are
the methods, properties and fields of a public class. The command line is no room to import from and has tests of its own.
The source is read, not imported: no extra has to be installed.

To change the list on purpose: ``python tests/test_public_names.py``, and a line in CHANGELOG.md for whoever calls what changed.
"""

from __future__ import annotations

import ast
import difflib
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "src" / "pieper"
LIST = Path(__file__).parent / "golden" / "public_names.txt"
NO_ROOMS = ("cli", "__main__")
AUTOMATIC = ("__init__", "__call__", "__getitem__", "__iter__", "__len__", "__contains__", "__enter__", "__exit__")


def public_names() -> list[str]:
    """The list as it is now: a line for each module, and below it one for each name."""
    lines: list[str] = []
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        parts = parts[:-1] if parts[-1] == "__init__" else parts
        if any(part.startswith("_") or part in NO_ROOMS for part in parts[1:]):
            continue
        names = list(_names_of_module(ast.parse(path.read_text(encoding="utf-8"))))
        if names:
            lines += ["", ".".join(parts), *(f"  {name}" for name in names)]
    return lines[1:]


def _names_of_module(module: ast.Module) -> Iterator[str]:
    listed = _listed(module)
    defined = {name: line for node in _statements(module.body) for name, line in _names_of(node, "")}
    members = [line for node in _statements(module.body) if isinstance(node, ast.ClassDef) for line in _members(node)]
    if listed is None:
        chosen = [name for name in defined if not name.startswith("_")]
    else:
        chosen = listed
    for name in sorted(chosen):
        yield defined.get(name, f"{name} (from elsewhere)")
        yield from sorted(member for member in members if member.startswith(f"{name}."))


def _listed(module: ast.Module) -> list[str] | None:
    for node in module.body:
        if isinstance(node, ast.Assign) and any(isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets):
            return [str(name) for name in ast.literal_eval(node.value) if not str(name).startswith("__")]
    return None


def _statements(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """Those of a body, and of its branches: a name that depends on a version is a name."""
    for node in body:
        if isinstance(node, ast.If):
            if "TYPE_CHECKING" not in ast.unparse(node.test):
                yield from _statements([*node.body, *node.orelse])
        elif isinstance(node, ast.Try):
            yield from _statements([*node.body, *node.orelse])
        else:
            yield node


def _names_of(node: ast.stmt, of: str) -> Iterator[tuple[str, str]]:
    """Names that a statement defines, each with its line on the list."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        yield node.name, _function(node, of)
    elif isinstance(node, ast.ClassDef):
        bases = ", ".join(ast.unparse(base) for base in node.bases)
        made_of = f", made of ({', '.join(_fields(node))})" if _is_record(node) else ""
        yield node.name, f"{of}{node.name}: class({bases}){made_of}"
    elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
        yield node.target.id, f"{of}{node.target.id}{'' if node.value is None else '=...'}"
    elif isinstance(node, ast.Assign):
        for target in node.targets:
            if isinstance(target, ast.Name) and not ast.unparse(node.value).startswith("NDArray["):  # a type for hints
                yield target.id, f"{of}{target.id}=..."


def _members(node: ast.ClassDef) -> Iterator[str]:
    record = _is_record(node)
    for statement in _statements(node.body):
        if record and isinstance(statement, ast.AnnAssign) and "ClassVar" not in ast.unparse(statement.annotation):
            continue  # said with the class, in the order in which it takes them
        for name, line in _names_of(statement, f"{node.name}."):
            if not name.startswith("_") or name in AUTOMATIC:
                yield line
            if isinstance(statement, ast.ClassDef) and not name.startswith("_"):
                yield from (f"{node.name}.{member}" for member in _members(statement))


def _is_record(node: ast.ClassDef) -> bool:
    """Whether its annotations are the arguments that make one."""
    said = [ast.unparse(each) for each in (*node.bases, *node.decorator_list)]
    return any(word.startswith(("NamedTuple", "dataclass", "TypedDict")) for word in said)


def _fields(node: ast.ClassDef) -> Iterator[str]:
    for statement in node.body:
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            if "ClassVar" in ast.unparse(statement.annotation):
                continue
            made_inside = statement.value is not None and "init=False" in ast.unparse(statement.value)
            default = " (made inside)" if made_inside else "" if statement.value is None else "=..."
            yield statement.target.id + default


def _function(node: ast.FunctionDef | ast.AsyncFunctionDef, of: str) -> str:
    decorators = [ast.unparse(decorator) for decorator in node.decorator_list]
    if any(d.endswith("property") for d in decorators):
        return f"{of}{node.name}: property"
    kind = next((d for d in decorators if d in ("classmethod", "staticmethod")), "")
    bound = 1 if of and kind != "staticmethod" else 0
    return f"{of}{node.name}({', '.join(_parameters(node.args, bound))})" + (f": {kind}" if kind else "")


def _parameters(arguments: ast.arguments, bound: int) -> Iterator[str]:
    """As in a signature, a default shown as ``=...``; the one that a method is bound to is left out."""
    plain = [*arguments.posonlyargs, *arguments.args]
    first_default = len(plain) - len(arguments.defaults)
    for i, argument in enumerate(plain):
        if i >= bound:
            yield argument.arg + ("=..." if i >= first_default else "")
        if arguments.posonlyargs and i == len(arguments.posonlyargs) - 1 and i >= bound:
            yield "/"
    if arguments.vararg is not None:
        yield f"*{arguments.vararg.arg}"
    elif arguments.kwonlyargs:
        yield "*"
    for argument, default in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True):
        yield argument.arg + ("" if default is None else "=...")
    if arguments.kwarg is not None:
        yield f"**{arguments.kwarg.arg}"


def test_the_public_names_are_those_on_the_list():
    frozen = LIST.read_text(encoding="utf-8").splitlines()
    now = public_names()
    changes = list(difflib.unified_diff(frozen, now, "on the list", "in the source", lineterm="", n=2))
    assert not changes, (
        "the public names are not those on the list:\n"
        + "\n".join(changes)
        + "\n\nWhoever calls what went, or has other parameters now, breaks. If that is meant, or a name is new: run\n"
        "    python tests/test_public_names.py\n"
        "and write it into CHANGELOG.md, with what to call instead of what went."
    )


def test_the_list_sees_functions_classes_and_what_their_parameters_are():
    source = """
from elsewhere import imported
LIMIT: int = 3
_hidden = 1
def solve(chain, /, T, *, seed=None, **more): ...
@dataclass(frozen=True)
class Point:
    x: float
    y: float = 0.0
class Answer(Base):
    kind: str = "none"
    _secret = 1
    def __init__(self, q=0): ...
    @property
    def status(self): ...
    @classmethod
    def of(cls, chain): ...
    @staticmethod
    def plain(a, b=1, *rest): ...
"""
    assert list(_names_of_module(ast.parse(source))) == [
        "Answer: class(Base)",
        "Answer.__init__(q=...)",
        "Answer.kind=...",
        "Answer.of(chain): classmethod",
        "Answer.plain(a, b=..., *rest): staticmethod",
        "Answer.status: property",
        "LIMIT=...",
        "Point: class(), made of (x, y=...)",
        "solve(chain, /, T, *, seed=..., **more)",
    ]
    assert list(_names_of_module(ast.parse("__all__ = ['solve', 'lazy']\n" + source))) == [
        "lazy (from elsewhere)",
        "solve(chain, /, T, *, seed=..., **more)",
    ]


if __name__ == "__main__":
    LIST.write_text("\n".join(public_names()) + "\n", encoding="utf-8")
