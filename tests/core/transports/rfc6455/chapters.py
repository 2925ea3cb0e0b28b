"""Every chapter, in the order of the table in the documentation."""

from __future__ import annotations

from tests.core.transports.rfc6455 import closing, compression, control, framing, utf8

CHAPTERS = (*framing.CHAPTERS, *control.CHAPTERS, *utf8.CHAPTERS, *closing.CHAPTERS, *compression.CHAPTERS)
