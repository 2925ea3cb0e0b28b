"""Asking the person at the agent's program for leave, before a tool does something."""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

#: Seconds for which an answer is waited for.
_ANSWER_SECONDS: Final = 600.0

#: Questions that wait for their answers at a time; beyond it the oldest are forgotten.
_MOST_QUESTIONS: Final = 256


@dataclass(frozen=True, slots=True)
class Question:
    """Pending question, with approved actions of the same kind.

    Attributes:
        text: what is asked.
        allowed: what was asked before, and allowed.
    """

    text: str
    allowed: frozenset[str]


@dataclass(frozen=True, slots=True)
class _Asked:
    question: Question
    owner: str
    digest: bytes
    until: float


class Questions:
    """Questions whose answers come with a later request.

    Each is for one action by one owner with identical arguments, and is answered once.
    """

    def __init__(self) -> None:
        self._waiting: dict[str, _Asked] = {}

    def ask(
        self, question: Question, owner: str, tool: str, arguments: Mapping[str, object], now: float
    ) -> str:
        """Note a question, and return the token under which its answer comes.

        Args:
            question: question to note.
            owner: identity of the agent.
            tool: with which tool.
            arguments: arguments of the tool.
            now: seconds on a clock that never goes back.
        """
        while len(self._waiting) >= _MOST_QUESTIONS:
            del self._waiting[next(iter(self._waiting))]
        word = secrets.token_urlsafe(24)
        self._waiting[word] = _Asked(question, owner, _digest(tool, arguments), now + _ANSWER_SECONDS)
        return word

    def answered(
        self, word: str, owner: str, tool: str, arguments: Mapping[str, object], now: float
    ) -> Question | None:
        """Return the question of an answer, for the same arguments as in :meth:`ask`; None if unknown."""
        asked = self._waiting.pop(word, None)
        if asked is None or asked.owner != owner or now > asked.until:
            return None
        return asked.question if asked.digest == _digest(tool, arguments) else None


def _digest(tool: str, arguments: Mapping[str, object]) -> bytes:
    return hashlib.sha256(json.dumps([tool, arguments], sort_keys=True).encode()).digest()
