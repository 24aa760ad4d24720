"""The commands of a session as a shell script that repeats it to the byte."""

from __future__ import annotations

import shlex

from ecm.workflow.app.contents import Contents
from ecm.workflow.app.demo import DEMO_FILES

_SCRIPT = """#!/bin/sh
# The steps of this session as commands. They write the same files, byte for byte:
#   sh script.sh NEW_FOLDER
set -e
from=$(cd "$(dirname "$0")" && pwd)
to=${1:?"give a new folder: sh script.sh NEW_FOLDER"}
[ -f "$from/steps.jsonl" ] || { echo "put this script into the session folder" >&2; exit 1; }
mkdir "$to"
"""


def script_of(contents: Contents) -> str:
    """Return the commands of the steps that count, as a shell script."""
    history = contents.journal.read()
    steps = [history.steps[number] for number in history.active]
    given = [name for step in steps if not step.argv for name in step.outputs]
    given += [name for name in DEMO_FILES if (contents.folder / name).is_file()]
    lines = [f'cp "$from"/{shlex.quote(name)} "$to"/' for name in dict.fromkeys(given)]
    lines.append('cd "$to"')
    lines += [shlex.join(["ecm", *step.argv]) for step in steps if step.argv]
    return _SCRIPT + "\n".join(lines) + "\n"
