"""XML of a URDF as elements: read with limits and without anything that reaches outside."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path
from xml.etree.ElementTree import ParseError

from defusedxml import DefusedXmlException, DTDForbidden
from defusedxml.ElementTree import XMLParser

from pieper.errors import UrdfError

MAX_BYTES = 16 * 1024 * 1024

MAX_DEPTH = 64

MAX_ELEMENTS = 100_000

MAX_ATTRIBUTES = 100


class Element:
    """An element with its attributes and children; text is not kept, URDF has none."""

    __slots__ = ("attributes", "children", "tag")

    def __init__(self, tag: str, attributes: dict[str, str]) -> None:
        self.tag = tag
        self.attributes = attributes
        self.children: list[Element] = []


class _Builder:
    """Receives the parser's events and stops at the limits."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.root: Element | None = None
        self.open: list[Element] = []
        self.count = 0

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.count += 1
        if self.count > MAX_ELEMENTS:
            raise UrdfError(self.source, "document", f"has more than {MAX_ELEMENTS} elements")
        if len(self.open) >= MAX_DEPTH:
            raise UrdfError(self.source, "document", f"is nested more than {MAX_DEPTH} elements deep")
        if len(attributes) > MAX_ATTRIBUTES:
            raise UrdfError(self.source, f"<{tag[:60]}>", f"has more than {MAX_ATTRIBUTES} attributes")
        element = Element(tag, dict(attributes))
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)

    def end(self, tag: str) -> None:
        self.open.pop()

    def data(self, text: str) -> None:
        """Text between elements means nothing in a URDF."""

    def close(self) -> Element | None:
        return self.root


def text_of(what: object, source: str | None) -> tuple[str | bytes, str, Path | None]:
    """The XML text, the name for messages, and the file when there is one."""
    if isinstance(what, (bytes, bytearray, memoryview)):
        data = bytes(what)
        name = source or "<string>"
        _check_size(len(data), name)
        return data.lstrip(b" \t\r\n"), name, None
    if isinstance(what, str) and (what.lstrip("\ufeff \t\r\n")[:1] == "<" or not what.strip() or "\n" in what):
        name = source or "<string>"
        _check_size(len(what), name)
        return what.lstrip("\ufeff \t\r\n"), name, None
    if not isinstance(what, (str, os.PathLike)):
        raise UrdfError(
            source or "<string>", "document", f"must be URDF text or a file name, got {type(what).__name__}"
        )
    raw = os.fspath(what)
    file = Path(os.fsdecode(raw))
    shown = str(file) if len(str(file)) <= 200 else str(file)[:197] + "..."
    name = source or shown
    try:
        status = file.stat()
        if not stat.S_ISREG(status.st_mode):
            raise UrdfError(name, "file", "is not a regular file; give the URDF file itself")
        with file.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except UrdfError:
        raise
    except (OSError, ValueError) as cause:
        reason = getattr(cause, "strerror", None) or str(cause)
        raise UrdfError(
            name, "file", f"cannot be read: {reason}; give a URDF file, or URDF text that starts with <"
        ) from cause
    _check_size(len(data), name)
    return data.lstrip(b" \t\r\n"), name, file


def _check_size(size: int, source: str) -> None:
    if size > MAX_BYTES:
        raise UrdfError(
            source, "document", f"is larger than {MAX_BYTES // 2**20} MiB; a URDF holds no meshes, only names"
        )


def parse(text: str | bytes, source: str) -> Element:
    """The root element; the parser of defusedxml with document types forbidden."""
    if not text.strip():
        raise UrdfError(source, "document", "is empty; a URDF starts with <robot name=...>")
    try:
        try:
            root = _tree(text, source)
        except ParseError as cause:
            if "unbound prefix" not in str(cause):
                raise
            root = _tree(_with_prefixes(text), source)
    except UrdfError:
        raise
    except DTDForbidden as cause:
        raise UrdfError(source, "document type", "<!DOCTYPE> is refused, a URDF needs none; remove it") from cause
    except DefusedXmlException as cause:
        raise UrdfError(source, "document", "entities and external references are refused; remove them") from cause
    except ParseError as cause:
        hint = "; the file may be cut off" if "no element found" in str(cause) or "unclosed" in str(cause) else ""
        if "unbound prefix" in str(cause):
            hint = "; expand a xacro file first, or give it the name *.xacro"
        raise UrdfError(source, "document", f"is not well-formed XML: {cause}{hint}") from cause
    except (ValueError, LookupError, OverflowError) as cause:
        raise UrdfError(source, "document", f"cannot be decoded: {cause}") from cause
    if not isinstance(root, Element):
        raise UrdfError(source, "document", "has no element; a URDF starts with <robot name=...>")
    return root


def _tree(text: str | bytes, source: str) -> object:
    parser = XMLParser(target=_Builder(source), forbid_dtd=True)
    parser.feed(text)
    return parser.close()


def _with_prefixes(text: str | bytes) -> str | bytes:
    """The same with the prefixes of foreign tags and attributes declared at the root; xacro's stays undeclared.

    Works on bytes of any encoding that has ASCII in it. Where it finds nothing the text stays as it is.
    """
    data = text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass")
    root = re.search(rb"<robot(?=[\s>])", data)
    foreign = set(re.findall(rb"[<\s]([A-Za-z_][\w.-]{0,60}):[A-Za-z_]", data))
    foreign = {prefix for prefix in foreign if prefix.lower() not in (b"xacro", b"xml", b"xmlns")}
    foreign -= set(re.findall(rb"xmlns:([A-Za-z_][\w.-]{0,60})", data))
    if root is None or not foreign or len(foreign) > MAX_ATTRIBUTES:
        return text
    declared = b"".join(b' xmlns:%b="undeclared:%b"' % (prefix, prefix) for prefix in sorted(foreign))
    data = data[: root.end()] + declared + data[root.end() :]
    return data if isinstance(text, bytes) else data.decode("utf-8", "surrogatepass")
