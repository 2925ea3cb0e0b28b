"""Reporting what should not have happened, from where nothing may be raised."""

from __future__ import annotations

import contextlib
import logging

logger = logging.getLogger("rwt_transports")


def report(text: str, *parts: object) -> None:
    """Log the exception that is being handled.

    A log handler that raises, because its disk is full or its server away, must not take other connections
    or the listener with it; what it was told is lost, which is its own affair.
    """
    with contextlib.suppress(Exception):
        logger.exception(text, *parts)
