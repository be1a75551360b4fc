"""`python -m wsnsim` is the command line."""

import sys

from wsnsim.cli import main

sys.exit(main())
