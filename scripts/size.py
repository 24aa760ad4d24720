"""Prints the lines of code of each part; `make test` shows them, a test holds the limits.

A line of code holds a token other than a comment or a docstring, which fields have as well. Of the
crates all lines count, without those of tests, benches and examples.

    python scripts/size.py            # the table
    python scripts/size.py python/ecm # by folder
"""

from __future__ import annotations

import argparse
import ast
import signal
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PARTS = {
    "python/ecm": "*.py",
    "benches": "*.py",
    "examples": "*.py",
    "tests": "*.py",
    "crates": "*.rs",
}
_SILENT = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENCODING, tokenize.ENDMARKER,
}  # fmt: skip


def python_lines(path: Path) -> int:
    """Lines that hold a token other than a comment or a docstring."""
    docstrings: set[int] = set()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            docstrings.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    lines: set[int] = set()
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):
            if token.type not in _SILENT:
                lines.update(range(token.start[0], token.end[0] + 1))
    return len(lines - docstrings)


def rust_lines(path: Path) -> int:
    """All lines."""
    return len(path.read_text(encoding="utf-8").splitlines())


def files_of(part: str) -> Iterator[Path]:
    """The files of a part; of the crates without built ones and tests."""
    left_out = {"target", "tests", "tests.rs", "benches", "examples"} if part == "crates" else set()
    for path in sorted((ROOT / part).rglob(PARTS[part])):
        if not left_out.intersection(path.relative_to(ROOT).parts):
            yield path


def size_of(part: str) -> tuple[int, int]:
    """Lines of code and number of files."""
    count = rust_lines if PARTS[part] == "*.rs" else python_lines
    sizes = [count(path) for path in files_of(part)]
    return sum(sizes), len(sizes)


def by_folder(part: str) -> dict[str, tuple[int, int]]:
    """The same of each folder within a part, the largest first."""
    count = rust_lines if PARTS[part] == "*.rs" else python_lines
    found: dict[str, list[int]] = defaultdict(list)
    for path in files_of(part):
        found[path.parent.relative_to(ROOT).as_posix()].append(count(path))
    ordered = sorted(found.items(), key=lambda item: -sum(item[1]))
    return {name: (sum(sizes), len(sizes)) for name, sizes in ordered}


def main() -> None:
    """Print the table."""
    if hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # `| head` has read enough
    layout = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=layout)
    parser.add_argument("part", nargs="?", choices=PARTS, help="show its folders")
    part = parser.parse_args().part
    rows = by_folder(part) if part else {name: size_of(name) for name in PARTS}
    for name, (lines, files) in rows.items():
        print(f"{name:40s} {lines:7,d} lines in {files:3d} files")


if __name__ == "__main__":
    main()
