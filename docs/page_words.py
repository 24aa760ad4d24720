"""Write the help of the browser page from the glossary: python docs/page_words.py.

docs/glossary.md has every word once. The page takes the terms below and all of its second part.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

GLOSSARY = Path(__file__).with_name("glossary.md")
WORDS = GLOSSARY.parents[1] / "python" / "ecm" / "workflow" / "app" / "page" / "words.js"
SHARED = (
    "pose", "wrench", "residual", "noise floor", "held out", "signature", "verdict", "controller",
    "correlation", "energy",
)  # fmt: skip


def page() -> str:
    """Return the text of words.js."""
    found = re.findall(
        r"^(##|###) (.+)\n((?:(?!#).*\n)*)", GLOSSARY.read_text(encoding="utf-8"), re.MULTILINE
    )
    words = {
        term: " ".join(meaning.replace("`", "").split())
        for marks, term, meaning in found
        if marks == "###" or term in SHARED
    }
    lines = (f"  {json.dumps(one)}: {json.dumps(words[one], ensure_ascii=False)}," for one in words)
    head = "// Written by docs/page_words.py from docs/glossary.md.\nexport const TERMS = {\n"
    return head + "\n".join(lines) + "\n};\n"


if __name__ == "__main__":
    WORDS.write_text(page(), encoding="utf-8")
