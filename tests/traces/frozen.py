"""Texts of errors and statuses that go out on the wire: clients may match them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import bson

FROZEN: Final = Path(__file__).with_name("frozen_texts.txt")

_HEARD: Final = re.compile(r"[\w-]+< (closed: |hex )?(.*)")
_JSON_LINE: Final = re.compile(r"(?:data: )?(\{.*\})")


def frozen_texts(transcripts: Iterable[str]) -> list[str]:
    """Return the texts in some transcripts, sorted, each once."""
    found = {text for transcript in transcripts for text in _texts_of(transcript)}
    return sorted(json.dumps(text, ensure_ascii=False) for text in found)


def _texts_of(transcript: str) -> Iterator[str]:
    for line in transcript.split("\n"):
        if heard := _HEARD.fullmatch(line):
            kind, rest = heard.groups()
            if kind == "closed: ":
                yield rest
            elif kind == "hex ":
                yield from _texts_of_bson(rest)
            else:
                yield from _texts_of_json(rest)
        elif found := _JSON_LINE.fullmatch(line):
            yield from _texts_of_json(found[1])


def _texts_of_bson(digits: str) -> Iterator[str]:
    try:
        yield from _texts_of_message(bson.decode(bytes.fromhex(digits)))
    except (bson.errors.InvalidBSON, ValueError):
        return  # Another encoding, or a line in which a stamp was replaced.


def _texts_of_json(text: str) -> Iterator[str]:
    try:
        message = json.loads(text)
    except ValueError:
        return  # A line in which a stamp was replaced.
    if isinstance(message, dict):
        yield from _texts_of_message(message)


def _texts_of_message(message: dict[str, Any]) -> Iterator[str]:
    match message:
        case {"op": "status", "msg": str(text)} | {"op": "status", "message": str(text)}:
            yield text
        case {"op": "serviceCallFailure", "message": str(text)}:
            yield text
        case {"op": "service_response" | "action_result", "result": False, "values": str(text)}:
            yield text
        case {"op": "service_response", "values": {"success": False, "message": str(text)}}:
            yield text
        case {"type": str(), "title": str(title), "status": int()}:
            yield title
            yield from (message[name] for name in ("detail", "instead") if name in message)
        case {"jsonrpc": "2.0", "error": {"message": str(text)}}:
            yield text
        case {"jsonrpc": "2.0", "result": {"isError": True, "content": list(content)}}:
            yield from (part["text"] for part in content)
