"""What is worked out once for a chain, kept with it."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar, cast

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

    from pieper.model.chain import Chain

Made = TypeVar("Made")

_MOST = 64  # a tool axis per target would fill the memory


def prepared(chain: Chain, what: str, key: Hashable, make: Callable[[], Made]) -> Made:
    """`make()`, made once for a chain, a name and a key, and kept as long as the chain lives.

    Parameters
    ----------
    chain : Chain
    what : str
        A name of its own for each use.
    key : hashable
        What else the result depends on. The last 64 are kept.
    make : callable
        Without arguments; makes the result from the chain, which it may hold.

    Returns
    -------
    What `make` returned.

    Examples
    --------
    >>> from pieper.model import catalog
    >>> arm = catalog.describe("ur5e").chain()
    >>> prepared(arm, "an example", None, list) is prepared(arm, "an example", None, list)
    True
    """
    # with the chain, not in a dictionary with weak keys: a result that holds its chain would never go
    kept = vars(chain).setdefault(f"_prepared_{what}", {})
    if key not in kept:
        made = make()
        if len(kept) >= _MOST:
            kept.clear()
        kept[key] = made
        return made
    return cast("Made", kept[key])
