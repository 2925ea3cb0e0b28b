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
    """One question, with those of the same act that have had their yes.

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
    """Questions that were asked and whose answers come with another request.

    Each is for one act by one owner with the very same arguments, and is answered once: so that an answer
    cannot be used again, or for something else.
    """

    def __init__(self) -> None:
        self._waiting: dict[str, _Asked] = {}

    def ask(
        self, question: Question, owner: str, tool: str, arguments: Mapping[str, object], now: float
    ) -> str:
        """Note a question; returns the word under which its answer comes.

        Args:
            question: see there.
            owner: who wants to act.
            tool: with which tool.
            arguments: of the tool.
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
        """The question that an answer is for; None where none was asked just so. Arguments as of
        :meth:`ask`."""
        asked = self._waiting.pop(word, None)
        if asked is None or asked.owner != owner or now > asked.until:
            return None
        return asked.question if asked.digest == _digest(tool, arguments) else None


def _digest(tool: str, arguments: Mapping[str, object]) -> bytes:
    return hashlib.sha256(json.dumps([tool, arguments], sort_keys=True).encode()).digest()
