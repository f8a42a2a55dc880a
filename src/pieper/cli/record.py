"""Arms as JSON: what ``pieper convert --json`` writes, every verb reads."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pieper.errors import DescriptionError, PieperError

if TYPE_CHECKING:
    from pieper.model.chain import Chain
    from pieper.model.dh import DhTable

_KEYS = ("name", "base", "tip", "joint_names", "screws", "home", "limits", "max_velocity", "max_effort", "coupling")


def screw_record(chain: Chain) -> dict[str, Any]:
    """The chain as plain data: screws at home, pose of the tip at home, names and limits."""
    return {key: getattr(chain, key) for key in _KEYS}


def from_file(path: str) -> Chain | DhTable:
    """The Denavit-Hartenberg table or the screws that a JSON file holds.

    Raises
    ------
    DescriptionError
        Not JSON, or neither of the two, or malformed.
    """
    try:
        record = json.loads(Path(path).read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as cause:
        raise DescriptionError(path, "file", f"is not JSON: {cause}") from cause
    try:
        if isinstance(record, dict) and "rows" in record:
            from pieper.model.dh import from_record

            return from_record(record)
        if isinstance(record, dict) and {"screws", "home", "joint_names"} <= record.keys():
            return _chain(record)
    except (PieperError, TypeError, ValueError, KeyError, AttributeError) as cause:
        raise DescriptionError(path, "file", f"is malformed: {cause}") from cause
    raise DescriptionError(
        path, "file", "holds neither DH rows (key 'rows') nor screws (keys 'screws', 'home', 'joint_names')"
    )


def _chain(record: dict[str, Any]) -> Chain:
    import numpy as np

    from pieper.model.chain import Chain

    known = {key: record[key] for key in _KEYS if record.get(key) is not None}
    known.setdefault("name", "arm")
    limits = record.get("limits") or [[None, None]] * len(known["joint_names"])
    known["limits"] = [
        [-np.inf if lower is None else lower, np.inf if upper is None else upper] for lower, upper in limits
    ]
    for key in ("max_velocity", "max_effort"):
        if key in known:
            known[key] = [np.inf if value is None else value for value in known[key]]
    return Chain(**known)
