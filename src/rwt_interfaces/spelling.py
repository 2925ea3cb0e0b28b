"""Words similar to a misspelt one, for error texts.

Clients choose the misspelt word, so a look-up must be cheap whatever it is: words are compared by the pairs
of letters that they share, a few words also by the letters, and only the nearest are compared letter by
letter.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterable
from itertools import islice, pairwise
from typing import Final

MAX_WORDS: Final = 500
"""Maximum number of words that are compared."""
MAX_LENGTH: Final = 120
"""Maximum number of characters of a word that is compared."""
FEW_WORDS: Final = 32
"""Maximum number of words that are also compared by single letters: `dorp` and `drop` share no pair."""
_COMPARED: Final = 4
"""Number of words that are compared letter by letter."""


class Words:
    """Known words, indexed for :meth:`similar`."""

    __slots__ = ("_few", "_with_pair")

    def __init__(self, known: Iterable[str]) -> None:
        self._with_pair: dict[tuple[str, str], list[str]] = {}
        words = [word for word in islice(known, MAX_WORDS) if len(word) <= MAX_LENGTH]
        self._few = words if len(words) <= FEW_WORDS else []
        for word in words:
            for pair in set(pairwise(word)):
                self._with_pair.setdefault(pair, []).append(word)

    def similar(self, word: str, count: int = 1, cutoff: float = 0.6) -> list[str]:
        """Return known words similar to `word`, the most similar first.

        Args:
            word: the misspelt word.
            count: maximum number of words returned.
            cutoff: minimum similarity, from 0 to 1.
        """
        if len(word) > MAX_LENGTH:
            return []
        import difflib  # Rarely needed, and slow to import.

        shared = Counter[str]()
        for pair in set(pairwise(word)):
            shared.update(self._with_pair.get(pair, ()))
        length = len(word)
        nearest = heapq.nlargest(
            _COMPARED, [(pairs / (length + len(each)), each) for each, pairs in shared.items()]
        )
        found = difflib.get_close_matches(word, [each for _, each in nearest], count, cutoff)
        if found or not self._few:
            return found
        letters = set(word)
        alike = heapq.nlargest(
            _COMPARED, self._few, key=lambda each: len(letters.intersection(each)) / (len(each) + 1)
        )
        return difflib.get_close_matches(word, alike, count, cutoff)
