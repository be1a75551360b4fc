"""`python -m wsnsim` is the command line."""

import sys

from wsnsim.cli import main

if __name__ == "__main__":  # a worker process of a campaign imports this file, and must not run it
    sys.exit(main())
