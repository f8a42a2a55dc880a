"""One thing that is measured, and what it must reach."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True)
class Mark:
    """One row of the table.

    Attributes
    ----------
    what : str
        Is measured.
    unit : str
        Of the figures.
    ours : float
        Of this package.
    report : float or None
        Of the report's method in the same run; None where it has no such answer.
    limit : float
    at_least : bool
        Whether the figure must not be below the limit; otherwise it must not be above.
    details : mapping
        What else was measured.
    """

    what: str
    unit: str
    ours: float
    limit: float
    at_least: bool = False
    report: float | None = None
    details: Mapping[str, Any] = field(default_factory=dict)

    @property
    def reached(self) -> bool:
        """Whether it is as it must be; what could not be measured is not."""
        return self.ours >= self.limit if self.at_least else self.ours <= self.limit

    @property
    def must(self) -> str:
        """The limit in words."""
        return f"{'>=' if self.at_least else '<='} {self.shown(self.limit)}"

    def shown(self, value: float | None) -> str:
        """Return a figure in words."""
        if value is None:
            return "-"
        return f"{value:.1%}" if self.unit == "share" else f"{value:.3g} {self.unit}".strip()
