"""A typer application as all of `ecm` uses it."""

from __future__ import annotations

from typing import Any

import typer

typed: tuple[str, ...] = ()
"""The words after `ecm` of the command at work, for a remedy that repeats it."""


def new_application(**options: Any) -> typer.Typer:
    """Return a typer application with plain help and errors."""
    return typer.Typer(
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        add_completion=False,
        context_settings={"help_option_names": ["--help", "-h"], "max_content_width": 80},
        **options,
    )
