"""`python -m wsnsim` is the command line."""

import contextlib
import sys
from pathlib import Path

import wsnsim.base.version as version

if __name__ == "__main__":  # a worker process of a campaign imports this file, and must not run it
    home = Path(version.__file__).resolve().parents[2]
    with contextlib.suppress(FileNotFoundError):  # the working directory was deleted
        if not sys.flags.safe_path and sys.path[0] == str(Path.cwd()) and home != Path.cwd():
            del sys.path[0]  # Python puts the working directory first, where files of others may stand
    from wsnsim.cli import main

    sys.exit(main())
