"""The result of a tool: texts and pictures, bounded in size."""

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
    """Plain values as compact JSON; NaN and infinities, which it has not, are null."""
    return msgspec.json.encode(value).decode()


def bounded(text: str, most: int) -> str:
    """A text of at most so many bytes of UTF-8, with a note in it where it was cut."""
    data = text.encode()
    if len(data) <= most:
        return text
    note = _CUT.format(most=most, size=len(data))
    return data[: max(0, most - len(note.encode()))].decode(errors="ignore") + note
