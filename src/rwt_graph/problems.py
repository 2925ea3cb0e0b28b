"""Reasons why topics and services of other processes cannot be used."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Final

logger = logging.getLogger(__name__)

#: Maximum reasons that are kept for one name.
_MOST_TEXTS: Final = 4


class Problems:
    """Problems of one graph, by topic or service, for clients and the log.

    Attributes:
        observers: called with the name and the text of each new problem.
    """

    def __init__(self) -> None:
        self.observers: set[Callable[[str, str], None]] = set()
        self._texts: dict[str, dict[str, None]] = {}

    def report(self, name: str, text: str) -> None:
        """Log a problem, and report it to the observers; no-op if it is known."""
        texts = self._texts.setdefault(name, {})
        if text in texts or len(texts) >= _MOST_TEXTS:
            return
        texts[text] = None
        logger.warning("%s", text)
        for observer in tuple(self.observers):
            observer(name, text)

    def forget(self, name: str) -> None:
        """Forget the problems of a name: what caused them has left."""
        self._texts.pop(name, None)

    def of(self, name: str) -> tuple[str, ...]:
        """Return the problems of a topic or service, the oldest first."""
        return tuple(self._texts.get(name, ()))
