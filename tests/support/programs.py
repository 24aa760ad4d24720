"""Programs that only some tests need: found, or one named line in the summary.

With ECM_REQUIRE_PROGRAMS=1 (`.ci/run`, after installing apt.txt) a missing one fails.
"""

from __future__ import annotations

import os
import shutil

import pytest


def need_program(*names: str) -> str:
    """Path of the first of these programs that is installed."""
    for name in names:
        found = shutil.which(name)
        if found is not None:
            return found
    message = f"{names[0]} is not installed (see apt.txt)"
    if os.environ.get("ECM_REQUIRE_PROGRAMS") == "1":
        pytest.fail(message)
    pytest.skip(message)
