"""The known name that may have been meant. It imports nothing, since the command line needs it early."""

from __future__ import annotations

from collections.abc import Iterable


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`; did you mean X?` with the nearest of the known words; empty if none is near, or `word` is known."""
    import difflib  # few mistakes are made, and it is not small

    words = list(known)
    found = [] if word in words else difflib.get_close_matches(word, words, n=1)
    return f"; did you mean {found[0]}?" if found else ""
