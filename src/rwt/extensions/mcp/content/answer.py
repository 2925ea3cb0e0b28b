"""Result of a tool: data, texts and images of bounded size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import msgspec

_CUT = "\n… cut at {most} bytes of {size}: ask for less, for example with `fields` or a narrower filter"


@dataclass(frozen=True, slots=True)
class Picture:
    """Image for the model, `image/jpeg` or `image/png`."""

    data: bytes
    mime_type: str


Part = str | Picture
Parts = tuple[Part, ...]
"""Texts and images, in the order in which the model sees them."""


@dataclass(frozen=True, slots=True)
class Answer:
    """Result of a tool.

    Attributes:
        data: structured content, as the tool's output schema describes it.
        shown: what the model reads; by default the data as JSON.
    """

    data: Mapping[str, object]
    shown: Parts = ()

    @property
    def parts(self) -> Parts:
        """Parts that the model reads."""
        return self.shown or (as_text(self.data),)


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


def bounded_value(value: object, most: int) -> object:
    """Return a plain value, or its JSON as a string, cut to a number of bytes, if that is longer."""
    text = as_text(value)
    return value if len(text.encode()) <= most else bounded(text, most)
