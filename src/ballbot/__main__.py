"""`python -m ballbot`: the commands, as `ballbot` runs them."""

import sys

from ballbot.cli.main import main

sys.exit(main())
