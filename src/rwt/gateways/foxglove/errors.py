"""What the gateway itself refuses of what a client of Foxglove's protocol asks; the client is told the text.

- :exc:`FoxgloveError`
    - :exc:`InvalidFrame`: a frame that is no message of the protocol
    - :exc:`NotPossible`: a message that asks for what is not there, or not now
"""

from __future__ import annotations


class FoxgloveError(Exception):
    """Base of what the gateway refuses. The text is one line: what, and what instead."""


class InvalidFrame(FoxgloveError):
    """A frame that is no message of the protocol."""


class NotPossible(FoxgloveError):
    """What is asked for does not exist, or exists already, or is too much."""
