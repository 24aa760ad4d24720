"""Formulas: `$...$` in a line and `$$` blocks become MathML, which a browser draws by itself."""

from __future__ import annotations

import re

from docsite.pages import outside_code

_BLOCK = re.compile(r"^\$\$\n(.*?)\n\$\$$", re.MULTILINE | re.DOTALL)
_INLINE = re.compile(r"(?<![\\$\w])\$(?![\s$])([^$\n]+?)(?<!\s)\$(?!\w)")


def with_maths(text: str) -> str:
    """Return a page with its formulas as MathML."""
    return outside_code(text, _formulas)


def _formulas(piece: str) -> str:
    piece = _BLOCK.sub(
        lambda m: f'<div class="formula">{_mathml(m.group(1), "block")}</div>', piece
    )
    return _INLINE.sub(lambda m: f"<span>{_mathml(m.group(1), 'inline')}</span>", piece)


def _mathml(formula: str, display: str) -> str:
    from latex2mathml.converter import convert  # noqa: PLC0415 - only a build needs it

    return convert(" ".join(formula.split()), display=display)
