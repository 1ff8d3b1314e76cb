"""``python -m lumbar``: the command ``lumbar`` where its folder is not on the PATH."""

import sys

from lumbar.cli.command import main

sys.exit(main())
