"""The process of one command: `python -m ecm.workflow.app.worker ARGUMENTS OF ecm`.

Its standard input is a pipe from the server. When the server dies, however it dies, the pipe ends
and so does this process: nothing works on for nobody.
"""

from __future__ import annotations

import os
import runpy
import sys
import threading

_INTERRUPTED = 130


def main() -> None:
    """Run the command line of this process as `ecm` does."""
    threading.Thread(target=_end_with_the_server, daemon=True).start()
    sys.argv[0] = "ecm"
    runpy.run_module("ecm", run_name="__main__", alter_sys=False)


def _end_with_the_server() -> None:
    while os.read(0, 1024):
        pass
    os._exit(_INTERRUPTED)


if __name__ == "__main__":
    main()
