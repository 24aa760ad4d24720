"""What every result does: one line at a prompt, all its words where it is printed or shown."""

from __future__ import annotations

from html import escape


class Printed:
    """A result that prints its words; at a prompt it is their first line.

    A subclass says its words by `__str__`.

    Examples
    --------
    >>> class Answer(Printed):
    ...     def __str__(self) -> str:
    ...         return "error 0.9 times the noise\\nfx_N 0.9"
    >>> Answer()
    <Answer: error 0.9 times the noise>
    >>> Answer()._repr_html_()
    '<pre>error 0.9 times the noise\\nfx_N 0.9</pre>'
    """

    def __repr__(self) -> str:
        """The first line of the words."""
        return f"<{type(self).__name__}: {str(self).partition(chr(10))[0]}>"

    def _repr_html_(self) -> str | None:
        """Show the words in a notebook."""
        return f"<pre>{escape(str(self))}</pre>"
