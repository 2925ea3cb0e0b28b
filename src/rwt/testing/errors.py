"""What a scripted robot raises.

- :exc:`ScriptError`: a script that cannot be played: an unknown key, field or file, or a wrong message.
- :exc:`BlockingWait`: a waiting method was called from a coroutine, whose event loop it would hold up.

An expectation that is not met raises :exc:`AssertionError`, as tests expect.
"""

from __future__ import annotations

from collections.abc import Iterable

from rwt_participant.spelling import nearest


class ScriptError(Exception):
    """The robot cannot be scripted so; the text says what, where and what instead."""


class BlockingWait(RuntimeError):
    """A method that waits was called on a thread whose event loop would stand still meanwhile."""


def instead(name: str, known: Iterable[str]) -> str:
    """The nearest known name in words, or all of them: ``did you mean `rate`?``."""
    names = list(known)
    near = nearest(name, names)
    if near:
        return f"did you mean `{near}`?"
    return f"known are {', '.join(names)}" if names else "none is known here"
