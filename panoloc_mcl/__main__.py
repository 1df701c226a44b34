"""``python -m panoloc_mcl`` is ``panoloc``."""

import sys

from panoloc_mcl.tools.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
