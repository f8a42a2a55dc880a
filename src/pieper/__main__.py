"""``python -m pieper``, which is the command ``pieper``."""

from __future__ import annotations

import sys


def main() -> int:
    """Run the command; Ctrl-C is no fault even while its modules are imported.

    Returns
    -------
    int
        The exit code, see `pieper.cli.main`.
    """
    try:
        from pieper.cli.main import main as run

        return run()
    except KeyboardInterrupt:
        sys.stderr.write("pieper: interrupted\n")
        return 130


if __name__ == "__main__":
    sys.exit(main())
