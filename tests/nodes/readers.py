"""Who asks for the pages of nodes."""

from __future__ import annotations


class SeesNothing:
    """A reader who may subscribe to no topic."""

    def may_subscribe(self, topic: str) -> bool:
        return False
