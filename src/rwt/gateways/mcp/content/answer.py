"""Result of a tool: texts and images of bounded size."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

_CUT = "\n… cut at {most} bytes of {size}: ask for less, for example with `fields` or a narrower filter"


@dataclass(frozen=True, slots=True)
class Picture:
    """Image for the model, `image/jpeg` or `image/png`."""

    data: bytes
    mime_type: str


Part = str | Picture
Answer = tuple[Part, ...]
"""Result of a tool, in the order in which the model sees it."""


def as_text(value: object) -> str:
    """Return plain values as compact JSON; NaN and infinities become null."""
    return msgspec.json.encode(value).decode()


def bounded(text: str, most: int) -> str:
    """Return a text cut to a number of bytes of UTF-8, with a note at the cut."""
    data = text.encode()
    if len(data) <= most:
        return text
    note = _CUT.format(most=most, size=len(data))
    return data[: max(0, most - len(note.encode()))].decode(errors="ignore") + note
