"""``pieper robots``: the arms that are built in."""

from __future__ import annotations

from typing import Any

from pieper.cli.arguments import Json
from pieper.cli.show import console, print_json, print_table


def robots(as_json: Json = False) -> int:
    """List the built-in robots, their short names and their sources.

    For example:
      pieper robots
    """
    from pieper.model import catalog

    rows = [_row(catalog.record(name), catalog.ALIASES) for name in catalog.names()]
    if as_json:
        print_json({"robots": rows})
        return 0
    print_table(
        console(),
        ("name", "also", ">joints", "robot"),
        [(row["name"], ", ".join(row["aliases"]), str(row["joints"]), row["title"]) for row in rows],
    )
    return 0


def _row(record: dict[str, Any], aliases: dict[str, str]) -> dict[str, Any]:
    if "screws" in record:
        count = len(record["screws"])
    else:
        count = sum(joint["type"] != "fixed" for joint in record["joints"])
    return {
        "name": record["name"],
        "aliases": sorted(alias for alias, name in aliases.items() if name == record["name"]),
        "title": record["title"],
        "joints": count,
        "base": record["base"],
        "tip": record["tip"],
        "source": record["source"],
    }
