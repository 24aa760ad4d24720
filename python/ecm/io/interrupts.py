"""Files are finished before an interruption takes effect."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class _Waiting:
    """How many blocks are under way, and whether an interruption waits for their end."""

    blocks = 0
    interrupted = False
    words: Callable[[], str] = str


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let an interruption of the command line wait until the block has ended.

    It is raised as KeyboardInterrupt then. Blocks may be nested. In a process that is not the
    command line, and outside its main thread, Ctrl-C does what it always does.

    Examples
    --------
    >>> try:
    ...     with uninterrupted():
    ...         waits = wait_to_interrupt()
    ...         print("the file is finished")
    ... except KeyboardInterrupt:
    ...     print("interrupted")
    the file is finished
    interrupted
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _Waiting.blocks += 1
    try:
        yield
    finally:
        _Waiting.blocks -= 1
        if _Waiting.interrupted and not _Waiting.blocks:
            _Waiting.interrupted = False
            raise KeyboardInterrupt


@contextmanager
def interruptible() -> Iterator[None]:
    """Let an interruption take effect at once, also inside `uninterrupted`.

    For what may wait for another program without end, as a pipe does for its reader.

    Examples
    --------
    >>> with uninterrupted(), interruptible():
    ...     wait_to_interrupt()
    False
    """
    before, _Waiting.blocks = _Waiting.blocks, 0
    try:
        yield
    finally:
        _Waiting.blocks = before


@contextmanager
def telling(words: Callable[[], str]) -> Iterator[None]:
    """Let the last line of a command that ends at once, at a second Ctrl-C, end with words.

    Examples
    --------
    >>> with telling(lambda: " The door is open."):
    ...     last_words()
    ' The door is open.'
    """
    _Waiting.words = words
    try:
        yield
    finally:
        _Waiting.words = str


def last_words() -> str:
    """Return what `telling` tells now; nothing outside it.

    Examples
    --------
    >>> last_words()
    ''
    """
    return _Waiting.words()


def wait_to_interrupt() -> bool:
    """Interrupt at the end of the block that is under way; False where there is none.

    Examples
    --------
    >>> wait_to_interrupt()
    False
    """
    _Waiting.interrupted = _Waiting.blocks > 0
    return _Waiting.interrupted
