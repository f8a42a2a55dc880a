"""An arm given where its chain is meant is told so."""

from __future__ import annotations

from pieper.errors import ArrayError
from pieper.model.chain import Chain


def check_chain(value: object) -> None:
    """Refuse what is no chain.

    >>> check_chain("ur5e")
    Traceback (most recent call last):
        ...
    pieper.errors.ArrayError: chain must be a Chain, as `arm.chain` is one, got str
    """
    if not isinstance(value, Chain):
        raise ArrayError(f"chain must be a Chain, as `arm.chain` is one, got {type(value).__name__}")
