"""``python -m deshake``: the command line."""

from __future__ import annotations

import sys

from deshake.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
