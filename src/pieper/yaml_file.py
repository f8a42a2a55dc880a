"""YAML files that people write, read so that a message can name file, line and field, and written whole or not at all.

Only plain data: no tags, no anchors, no key twice, within a size and a depth.
"""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pieper.atomic_file import write_text
from pieper.errors import MissingExtraError, PieperError, VisionError, unknown_name

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

LARGEST = 1 << 20
"""Bytes of a file that is read."""

DEEPEST = 32
"""Lists and sections inside each other."""

_FLOAT = re.compile(r"[-+]?(\d[\d_]*\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)  # YAML 1.1 takes 1e-3 for a word
_TAGS = {f"tag:yaml.org,2002:{name}" for name in ("null", "bool", "int", "float", "str", "timestamp")}
_MISSING: Any = object()


def _yaml(extra: str = "perception") -> Any:
    try:
        return import_module("yaml")
    except ImportError as cause:
        raise MissingExtraError("PyYAML", extra, "a YAML file") from cause


class _Source(NamedTuple):
    """The file that is read, as it was named, and what is raised about it."""

    file: str
    error: type[PieperError]


class Section:
    """A mapping in a file, with the line of each of its fields.

    Every reader below takes the name of a field, and raises an error with file, line and field where the field is missing or is not
    what it should be; with `default`, a missing one gives that.

    Attributes
    ----------
    file : str
        As it was named.
    field : str
        Where in the file, as in ``colors.red``; empty for the whole file.
    line : int
        From 1.
    """

    def __init__(self, source: _Source, field: str, node: Any, rows: dict[str, Any]) -> None:
        self._source, self.field = source, field
        self.file = source.file
        self.line: int = node.start_mark.line + 1
        self._rows = rows

    def __contains__(self, key: str) -> bool:
        return key in self._rows

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def error(self, key: str, reason: str) -> PieperError:
        """Build the error about a field, to be raised; an empty `key` is the section itself."""
        return _error(self._source, self._rows.get(key, self.line), self._name(key), reason)

    def only(self, *known: str) -> None:
        """Refuse fields of other names."""
        for key in self._rows:
            if key not in known:
                hint = str(unknown_name("field", key, known, self.field or "this file"))
                raise self.error(key, hint)

    def text(self, key: str, default: Any = _MISSING) -> str:
        """Return a word or a sentence."""
        value = self._scalar(key, default)
        if value is default or isinstance(value, str):
            return value
        raise self.error(key, f"must be text, got {value!r}; put it in quotes")

    def boolean(self, key: str, default: Any = _MISSING) -> bool:
        """Return true or false."""
        value = self._scalar(key, default)
        if value is default or isinstance(value, bool):
            return value
        raise self.error(key, f"must be true or false, got {value!r}")

    def integer(self, key: str, default: Any = _MISSING, *, least: int | None = None, most: int | None = None) -> int:
        """Return a whole number within bounds."""
        value = self._scalar(key, default)
        if value is default:
            return value  # type: ignore[no-any-return]
        if isinstance(value, bool) or not isinstance(value, int):
            raise self.error(key, f"must be a whole number, got {value!r}")
        self._within(key, value, least, most)
        return value

    def number(
        self, key: str, default: Any = _MISSING, *, least: float | None = None, most: float | None = None
    ) -> float:
        """Return a finite number within bounds."""
        value = self._scalar(key, default)
        if value is default:
            return value  # type: ignore[no-any-return]
        number = self._number(key, self._rows[key])
        self._within(key, number, least, most)
        return number

    def array(self, key: str, shape: tuple[int | None, ...], default: Any = _MISSING) -> NDArray[np.float64]:
        """Return finite numbers in nested lists of a shape, such as (None, 3), in which None stands for any length."""
        if key not in self._rows:
            return self._default(key, default)  # type: ignore[no-any-return]
        values = self._nested(key, self._rows[key], len(shape))
        try:
            array = np.array(values, dtype=np.float64)
        except ValueError:  # ragged
            array = np.empty((0,) * 9)
        if array.size == 0 and len(shape) > 1 and array.ndim == 1 and shape[0] is None:
            array = array.reshape(0, *(n or 0 for n in shape[1:]))
        fits = array.ndim == len(shape) and all(n is None or n == m for n, m in zip(shape, array.shape, strict=True))
        if not fits:
            wanted = " x ".join("any" if n is None else str(n) for n in shape)
            got = "rows of different lengths" if array.ndim == 9 else " x ".join(map(str, array.shape)) or "one"
            raise self.error(key, f"must be {wanted} numbers in lists, got {got}")
        return array

    def texts(self, key: str, default: Any = _MISSING) -> list[str]:
        """Return a list of words."""
        if key not in self._rows:
            return self._default(key, default)  # type: ignore[no-any-return]
        found = []
        for i, node in enumerate(self._list(key)):
            value = _value(self._source, f"{self._name(key)}[{i}]", node)
            if not isinstance(value, str):
                raise _error(
                    self._source, node, f"{self._name(key)}[{i}]", f"must be text, got {value!r}; put it in quotes"
                )
            found.append(value)
        return found

    def section(self, key: str, default: Any = _MISSING) -> Section:
        """Return the section of that name."""
        if key not in self._rows:
            return self._default(key, default)  # type: ignore[no-any-return]
        return _section(self._source, self._name(key), self._rows[key])

    def sections(self, key: str, default: Any = _MISSING) -> list[Section]:
        """Return the sections in a list."""
        if key not in self._rows:
            return self._default(key, default)  # type: ignore[no-any-return]
        return [_section(self._source, f"{self._name(key)}[{i}]", node) for i, node in enumerate(self._list(key))]

    def plain(self, *keys: str) -> dict[str, Any]:
        """Return fields as plain data, those of the keys that are there: what is kept, but not read."""
        return {key: _data(self._source, self._name(key), self._rows[key]) for key in keys if key in self._rows}

    def _name(self, key: str) -> str:
        return ".".join(part for part in (self.field, key) if part)

    def _default(self, key: str, default: Any) -> Any:
        if default is _MISSING:
            raise self.error(key, "is missing")
        return default

    def _scalar(self, key: str, default: Any) -> Any:
        if key not in self._rows:
            return self._default(key, default)
        return _value(self._source, self._name(key), self._rows[key])

    def _list(self, key: str) -> list[Any]:
        node = self._rows[key]
        if node.id != "sequence":
            raise self.error(key, f"must be a list, as in `- first`, got {_shown(node)}")
        return list(node.value)

    def _number(self, key: str, node: Any) -> float:
        value = _value(self._source, self._name(key), node)
        if isinstance(value, str) and not node.style and _FLOAT.fullmatch(value):
            value = float(value)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise _error(self._source, node, self._name(key), f"must be a number, got {value!r}")
        try:
            number = float(value)
        except OverflowError:
            number = np.inf
        if not np.isfinite(number):
            raise _error(self._source, node, self._name(key), f"must be a finite number, got {_shown(node)}")
        return number

    def _nested(self, key: str, node: Any, depth: int) -> Any:
        if depth == 0:
            if node.id != "scalar":
                raise _error(self._source, node, self._name(key), f"must be a number here, got {_shown(node)}")
            return self._number(key, node)
        if node.id != "sequence":
            raise _error(self._source, node, self._name(key), f"must be a list of numbers, got {_shown(node)}")
        return [self._nested(key, child, depth - 1) for child in node.value]

    def _within(self, key: str, value: float, least: float | None, most: float | None) -> None:
        if (least is not None and value < least) or (most is not None and value > most):
            bounds = [f"at {word} {bound:g}" for word, bound in (("least", least), ("most", most)) if bound is not None]
            raise self.error(key, f"must be {' and '.join(bounds)}, got {value:g}")


def _error(source: _Source, where: Any, field: str, reason: str) -> PieperError:
    line = where if isinstance(where, int) else where.start_mark.line + 1
    place = f"{source.file}, line {line}, {field}" if field else f"{source.file}, line {line}"
    return source.error(f"{place}: {reason}")


def _shown(node: Any) -> str:
    """What stands there, in words."""
    if node.id == "scalar":
        return repr(node.value[:40])
    return "a list" if node.id == "sequence" else "a section"


def _section(source: _Source, field: str, node: Any) -> Section:
    if node.id != "mapping":
        raise _error(source, node, field, f"must be a section of fields, as in `name: value`, got {_shown(node)}")
    rows: dict[str, Any] = {}
    for key, value in node.value:
        name = _value(source, field, key)
        if not isinstance(name, str):
            name = str(key.value)  # a number or `no` as a name
        if name in rows:
            raise _error(source, key, f"{field}.{name}".lstrip("."), "is there twice; leave one of them out")
        rows[name] = value
    return Section(source, field, node, rows)


def _value(source: _Source, field: str, node: Any) -> Any:
    """What a scalar means."""
    if node.id != "scalar":
        raise _error(source, node, field, f"must be a single value, got {_shown(node)}")
    if node.tag not in _TAGS:
        raise _error(source, node, field, f"tags such as {node.tag} are not read; plain values only")
    if node.tag.endswith("timestamp"):
        return node.value  # a date stays the word that it is
    try:
        return _yaml().constructor.SafeConstructor().construct_object(node)
    except (ValueError, OverflowError, AttributeError, KeyError, IndexError):
        raise _error(source, node, field, f"cannot be read as a value: {node.value[:40]!r}") from None


def _data(source: _Source, field: str, node: Any) -> Any:
    if node.id == "mapping":
        section = _section(source, field, node)
        return section.plain(*section)
    if node.id == "sequence":
        return [_data(source, f"{field}[{i}]", child) for i, child in enumerate(node.value)]
    return _value(source, field, node)


def read_yaml(
    path: str | Path, *, largest: int = LARGEST, error: type[PieperError] = VisionError, extra: str = "perception"
) -> Section:
    """Read a YAML file whose top is a section of fields.

    Parameters
    ----------
    path : str or Path
    largest : int
        Bytes; a file that is larger is refused before it is read.
    error : type of PieperError
        What is raised, made from one message.
    extra : str
        The extra that brings PyYAML, for the message when it is missing.

    Returns
    -------
    Section

    Raises
    ------
    OSError
        The file is not there, or cannot be read.
    VisionError
        It is too large, not UTF-8, not YAML, or has tags, anchors or more than one document. Another type, where `error` names one.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "camera.yaml"
    >>> write_yaml(path, {"size": [640, 480], "lens": {"focal": 800.5}})
    >>> camera = read_yaml(path)
    >>> camera.section("lens").number("focal")
    800.5
    >>> camera.array("size", (3,))
    Traceback (most recent call last):
        ...
    pieper.errors.VisionError: ...camera.yaml, line 1, size: must be 3 numbers in lists, got 2
    """
    with Path(path).open("rb") as file:
        raw = file.read(largest + 1)
    if len(raw) > largest:
        raise error(f"{path}: is larger than {largest} bytes, the most that is read of a YAML file")
    return parse_yaml(raw, str(path), error=error, extra=extra)


def parse_yaml(raw: bytes, name: str, *, error: type[PieperError] = VisionError, extra: str = "perception") -> Section:
    """Read YAML from bytes, as `read_yaml` does from a file."""
    yaml = _yaml(extra)
    source = _Source(name, error)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as cause:
        line = raw.count(b"\n", 0, cause.start) + 1
        raise error(f"{name}, line {line}: is not UTF-8 text") from None
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        _plain(yaml, source, yaml.parse(text, Loader=loader))
        node = yaml.compose(text, Loader=loader)
    except yaml.MarkedYAMLError as cause:
        mark = cause.problem_mark or cause.context_mark
        raise error(f"{name}, line {mark.line + 1 if mark else 1}: {cause.problem or cause.context}") from None
    except error:
        raise
    except (yaml.YAMLError, ValueError) as cause:  # characters that YAML forbids
        position = getattr(cause, "position", None)
        line = text.count("\n", 0, position) + 1 if isinstance(position, int) else 1
        raise error(f"{name}, line {line}: {getattr(cause, 'reason', cause)}") from None
    if node is None:
        raise error(f"{name}, line 1: the file is empty")
    return _section(source, "", node)


def _plain(yaml: Any, source: _Source, events: Any) -> None:
    """Refuse what would make a small file large, or a flat reader deep."""
    depth = documents = 0
    for event in events:
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise _error(source, event, "", "anchors and aliases (&, *) are not read; write the value out")
        documents += isinstance(event, yaml.DocumentStartEvent)
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise _error(source, event, "", f"is nested deeper than {DEEPEST} levels")
        if documents > 1:
            raise _error(source, event, "", "holds a second document; one is read")


def write_yaml(path: str | Path, data: Mapping[str, Any], *, comment: str = "", extra: str = "perception") -> None:
    """Write a section of fields, whole or not at all.

    Parameters
    ----------
    path : str or Path
        Replaced if it is there.
    data : mapping
        Text, numbers, booleans, None, arrays, and mappings and sequences of those, in the order in which they are to be read.
    comment : str
        Lines for people, written above as comments.
    extra : str
        As in `read_yaml`.

    Raises
    ------
    OSError
        The file cannot be written; what was there before stays.
    """
    head = "".join(f"# {line}".rstrip() + "\n" for line in comment.splitlines())
    write_text(path, head + as_yaml(data, extra=extra))


def as_yaml(data: Mapping[str, Any], *, extra: str = "perception") -> str:
    """Return the text that `write_yaml` writes.

    >>> print(as_yaml({"name": "red", "mean": np.array([0.5, 2.0])}), end="")
    name: red
    mean: [0.5, 2.0]
    """
    yaml = _yaml(extra)

    class Dumper(yaml.SafeDumper):  # type: ignore[misc, name-defined]
        def ignore_aliases(self, data: Any) -> bool:
            return True

        def represent_list(self, data: list[Any]) -> Any:
            flow = not any(isinstance(part, dict) or (isinstance(part, list) and len(part) > 4) for part in data)
            return self.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=flow)

        def represent_text(self, data: str) -> Any:
            odd = any(mark in data for mark in "\x85\u2028\u2029")  # lines of Unicode, which would be read as spaces
            return self.represent_scalar("tag:yaml.org,2002:str", data, style='"' if odd else None)

    Dumper.add_representer(list, Dumper.represent_list)
    Dumper.add_representer(str, Dumper.represent_text)
    text: str = yaml.dump(_simple(data), Dumper=Dumper, sort_keys=False, allow_unicode=True, width=120)
    return text


def _simple(data: Any) -> Any:
    if isinstance(data, dict) or hasattr(data, "items"):
        return {str(key): _simple(value) for key, value in data.items()}
    if isinstance(data, np.ndarray | np.generic):
        return _simple(data.tolist())
    if isinstance(data, list | tuple):
        return [_simple(value) for value in data]
    return str(data) if isinstance(data, Path) else data
