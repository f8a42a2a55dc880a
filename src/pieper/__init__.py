"""Kinematics and inverse kinematics of serial robot arms.

>>> import pieper
>>> arm = pieper.load("ur5e")
>>> arm.fk([0.0, -1.2, 1.4, -1.7, -1.57, 0.0]).shape
(4, 4)
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from pieper._version import __version__

if TYPE_CHECKING:
    from pieper.arm import Arm, load
    from pieper.errors import PieperError
    from pieper.model.chain import Chain

__all__ = ["Arm", "Chain", "PieperError", "__version__", "load"]

# Loaded when first used, so that `import pieper` and `pieper --help` stay quick.
_HOMES = {
    "Arm": "pieper.arm",
    "load": "pieper.arm",
    "PieperError": "pieper.errors",
    "Chain": "pieper.model.chain",
}


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _HOMES:
        raise AttributeError(f"module 'pieper' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def _show_arms_in_notebooks() -> None:
    """Have IPython, where this runs in it, show an arm as picture and table. Without IPython this is one look at a dictionary."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    if shell is not None:

        def html(arm: Arm) -> str:
            from pieper.viewer import notebook

            return notebook.html(arm)

        shell.display_formatter.formatters["text/html"].for_type_by_name("pieper.arm", "Arm", html)


_show_arms_in_notebooks()
