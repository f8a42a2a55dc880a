"""``python -m pieper``: the same as the command ``pieper``."""

import sys

from pieper.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
