"""Errors of scripted robots. A failed expectation raises :exc:`AssertionError`."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from rwt_interfaces.structs import MessageType
from rwt_participant.messages import MessageLike, to_payload
from rwt_participant.spelling import nearest


class ScriptError(Exception):
    """The script cannot be played: an unknown key, field or file, or an invalid message."""


class BlockingWait(RuntimeError):
    """A blocking method was called from a coroutine, and would block its event loop."""


def check_messages(
    type: MessageType, messages: Iterable[MessageLike | None], now: Callable[[], int], owner: str
) -> None:
    """Raise :exc:`ScriptError` if a message does not fit its type; None stands for a default message.

    Args:
        owner: topic, service or action, for the error.
    """
    for message in messages:
        try:
            to_payload(type, {} if message is None else message, now)
        except ValueError as error:
            raise ScriptError(f"{owner} ({type.name}): {error}") from None


def instead(name: str, known: Iterable[str]) -> str:
    """Return a hint that names the nearest known name, or all of them: ``did you mean `rate`?``."""
    names = list(known)
    near = nearest(name, names)
    if near:
        return f"did you mean `{near}`?"
    return f"known are {', '.join(names)}" if names else "none is known here"
