"""Errors of the Foxglove gateway; their texts are sent to the client."""

from __future__ import annotations


class FoxgloveError(Exception):
    """Base of the gateway's errors. The text is one line: what failed, and what to do instead."""


class InvalidFrame(FoxgloveError):
    """A frame is not a message of the protocol."""


class NotPossible(FoxgloveError):
    """The request names something that does not exist or exists already, or exceeds a limit."""
