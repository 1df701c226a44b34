"""``python -m panoloc_mcl`` is ``panoloc``."""

import sys

from panoloc_mcl.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
