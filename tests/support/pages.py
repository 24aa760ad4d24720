"""Runs the code blocks of a page.

```python            executed; a ```text block right after it is its exact output
```python NAME       written to NAME
```sh                executed line by line with the package's commands
```rust              its lines are compiled as an example of ecm-poly
```toml NAME         written to NAME
```csv NAME          written to NAME
```text              only right after a block that prints; ... stands for anything
"""

from __future__ import annotations

import os
import re
import shlex
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import pytest

from ecm.cli import run as ecm
from support.neck import ROOT
from support.programs import ended

FENCE = re.compile(r"^```(\w+)(?: +(\S+))?\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Block:
    language: str
    name: str
    text: str
    line: int


def blocks(path: Path) -> list[Block]:
    text = path.read_text(encoding="utf-8")
    return [
        Block(m.group(1), m.group(2) or "", m.group(3), text.count("\n", 0, m.start()) + 1)
        for m in FENCE.finditer(text)
    ]


def run(folder: Path, *command: str) -> str:
    """What a command prints that is typed in a folder."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "COLUMNS": "100"}
    return ended(*command, cwd=folder, env=environment).stdout


def run_apart(block: Block, folder: Path, _where: str) -> str:
    """Run a block in a process of its own; what it prints."""
    how = (sys.executable, "-c") if block.language == "python" else ("bash", "-euc")
    return run(folder, *how, block.text)


def run_here(block: Block, folder: Path, where: str) -> str:
    """Run a block in this process and folder, where it is Python or plain commands of `ecm`.

    Nothing is imported again, which is most of the time of a short command.
    """
    printed, before = StringIO(), Path.cwd()
    os.chdir(folder)
    try:
        with redirect_stdout(printed):
            if block.language == "python":
                exec(compile(block.text, where, "exec"), {"__name__": "__main__"})
            else:
                for line in block.text.replace("\\\n", " ").splitlines():
                    program, *arguments = shlex.split(line, comments=True)
                    assert program == "ecm", f"{where}: only plain commands of ecm: {line}"
                    assert ecm(arguments) == 0, f"{where}: {line} failed\n{printed.getvalue()}"
    finally:
        os.chdir(before)
    return printed.getvalue()


def follow(
    found: list[Block],
    page: str,
    folder: Path,
    run_block: Callable[[Block, Path, str], str] = run_apart,
) -> str | None:
    """Run the blocks of a page in a folder; what the last one prints, where nothing checked it."""
    printed: str | None = None
    for block in found:
        where = f"{page}:{block.line}"
        if (block.language == "python" and not block.name) or block.language == "sh":
            printed = run_block(block, folder, where)
        elif block.language in ("toml", "csv", "python"):
            assert block.name, f"{where}: a {block.language} block needs a file name"
            (folder / block.name).write_text(block.text, encoding="utf-8")
            printed = None
        elif block.language == "rust":  # lines of an example that the tests of a crate compile
            example = (ROOT / "crates/ecm-poly/src/pose_model.rs").read_text(encoding="utf-8")
            lines = re.findall(r"^ *((?:use|let \S+ = .*[Mm]odel).*)$", block.text, re.MULTILINE)
            assert lines, where
            assert [line for line in lines if f"/// {line}\n" not in example] == [], where
        elif block.language == "text":
            assert printed is not None, f"{where}: no block before it prints"
            pattern = re.escape(block.text.strip()).replace(re.escape("..."), "(?s:.*)")
            assert re.fullmatch(pattern, printed.strip()), f"{where} prints else:\n{printed}"
            printed = None
        else:
            pytest.fail(f"{where}: unknown language {block.language!r}")
    return printed
