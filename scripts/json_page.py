"""Write the page about ``--json`` from its schema: ``python scripts/json_page.py``; a test compares the two."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

GUIDES = Path(__file__).parents[1] / "docs" / "guides"
SCHEMA, PAGE = GUIDES / "json_output.json", GUIDES / "json_output.md"

HEAD = """# Output for scripts

<!-- written by scripts/json_page.py from json_output.json -->

`--json` prints one JSON object on standard output and nothing else there. Units are those of the [conventions](../conventions.md), whatever
`--deg` says: metres, radians, seconds. Numbers are printed in full, so that they are the same when they are read again. `null` stands for what is infinite, not known, or
does not apply. No key is ever left out.

```console
$ pieper fk ur5e 0 -1 1 0 0 0 --json
{
  "arm": "ur5e",
  "base": "base_link",
  "tip": "tool0",
...
  "position": [
...
```

```python
import json
import subprocess
import sys

line = [sys.executable, "-m", "pieper", "ik", "ur5e", "0.4", "0.2", "0.3", "--rpy", "3.14159", "0", "0", "--json"]
answer = json.loads(subprocess.run(line, capture_output=True, text=True, check=True).stdout)
print(answer["status"], len(answer["answers"]), len(answer["answers"][0]["q"]))
```

```text
reached 8 6
```

Exit codes are those of [the command line](command_line.md): with 1 (not reached) the object is printed too and says why. With 2, 3, 4 and 130 standard
output is empty, and the last line on standard error is an object of its own:

```console
$ pieper fk mh13 0 --json
{"error": "no robot 'mh13'; did you mean 'mh12'? ...", "kind": "UnknownNameError", "exit_code": 2}
(exit code 2)
```

The tables below are made from {download}`a JSON Schema <json_output.json>` (2020-12), which has an entry under `$defs` for each of them and which the output of every verb is tested
against. It has two words of its own: `unit`, and `shape`, in which the same letter is the same number within one output: `n` joints, `k` axes,
`m` points. Keys may be added in later versions; those that are there stay.
"""


def page() -> str:
    """The page as text."""
    definitions = json.loads(SCHEMA.read_text(encoding="utf-8"))["$defs"]
    return HEAD + "".join(section(name, schema) for name, schema in definitions.items())


def section(name: str, schema: dict[str, Any]) -> str:
    """One output: a heading, a sentence, and a row for each field."""
    verb, comma, rest = name.partition(",")
    title = f"`pieper {verb}`{comma}{rest}" if not verb.startswith("an ") else name.capitalize()
    lines = ["", f"## {title}", "", schema["description"], "", "| Field | Type | Unit | |", "|---|---|---|---|"]
    return "\n".join(lines + list(rows(schema, ""))) + "\n"


def rows(schema: dict[str, Any], prefix: str) -> Any:
    """A row for each field, those within a field behind it."""
    for key, field in schema["properties"].items():
        name, inner = f"{prefix}{key}", field
        if "$ref" in field:
            yield f"| `{name}` | object | | as of `pieper {field['$ref'].rpartition('/')[2]}` |"
            continue
        said = field["description"]
        if "enum" in field:
            said = f"{said} One of {', '.join(f'`{word}`' if word != '' else 'nothing' for word in field['enum'])}."
        yield f"| `{name}` | {kind(field)} | {field.get('unit', '')} | {said} |"
        if field.get("type") == "array" and "properties" in field["items"]:
            name, inner = f"{name}[]", field["items"]
        if "properties" in inner:
            yield from rows(inner, f"{name}.")


def kind(field: dict[str, Any]) -> str:
    """The type in words, with the shape of an array."""
    types = field["type"] if isinstance(field["type"], list) else [field["type"]]
    words = " or ".join(types)
    if "shape" in field:
        deep: Any = field
        while "items" in deep:
            deep = deep["items"]
        kinds = deep["type"] if isinstance(deep["type"], list) else [deep["type"]]
        shape = ", ".join(map(str, field["shape"])) + ("," if len(field["shape"]) == 1 else "")
        if field["shape"] == ["any"]:
            return f"{words} of {kinds[0]}"
        return f"{words} ({shape}) of {' or '.join(kinds)}"
    return f"{words} of objects" if types[0] == "array" else words


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
