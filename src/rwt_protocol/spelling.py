"""The known word that may have been meant. It imports nothing, since the command line needs it early."""

from __future__ import annotations

from collections.abc import Iterable


def nearest(word: str, known: Iterable[str]) -> str | None:
    """The word of `known` that is most like `word`; None if none is like it."""
    import difflib  # few mistakes are made, and it is not small

    found = difflib.get_close_matches(word, list(known), n=1)
    return found[0] if found else None
