"""Errors of scripted robots. A failed expectation raises :exc:`AssertionError`."""

from __future__ import annotations

from collections.abc import Iterable

from rwt_participant.spelling import nearest


class ScriptError(Exception):
    """The script cannot be played: an unknown key, field or file, or an invalid message."""


class BlockingWait(RuntimeError):
    """A blocking method was called from a coroutine, and would block its event loop."""


def instead(name: str, known: Iterable[str]) -> str:
    """Return a hint that names the nearest known name, or all of them: ``did you mean `rate`?``."""
    names = list(known)
    near = nearest(name, names)
    if near:
        return f"did you mean `{near}`?"
    return f"known are {', '.join(names)}" if names else "none is known here"
