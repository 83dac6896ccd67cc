"""`python -m part2gs_robotics` is `part2gs-robot`."""

import sys

from part2gs_robotics.cli import main

sys.exit(main())
