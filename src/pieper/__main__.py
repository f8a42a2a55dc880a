"""``python -m pieper``: the same as the command ``pieper``."""

import sys

from pieper.cli.main import main

sys.exit(main())
