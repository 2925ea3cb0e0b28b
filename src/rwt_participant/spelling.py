"""Suggestions for misspelt names. Imports little, because the command line needs it early."""

from __future__ import annotations

from collections.abc import Iterable


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the known word that is most similar to `word`; None if none is similar."""
    from rwt_interfaces.spelling import Words  # Rarely needed, and slow to import.

    found = Words(known).similar(word)
    return found[0] if found else None


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return `; did you mean X?` with the nearest known word; empty if there is none, or `word` is known."""
    words = list(known)
    found = None if word in words else nearest(word, words)
    return f"; did you mean {found}?" if found else ""
