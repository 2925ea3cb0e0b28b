"""Unwrapping of frames: fragments, png, cbor."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rosbridge_conformance.suite.matching import Difference
from rosbridge_conformance.suite.values import NotJson, Value, as_text, as_value, read_json, shorten
from rosbridge_conformance.wire.cbor import NotCbor, read_cbor
from rosbridge_conformance.wire.png import NotPng, read_data


def decode_text(raw: str | bytes) -> Value | Difference:
    """Return the value of a JSON text frame."""
    if isinstance(raw, bytes):
        return Difference("", "a text frame", f"a binary frame of {len(raw)} bytes")
    try:
        return as_value(read_json(raw))
    except NotJson as error:
        return Difference("", "JSON", f"{shorten(raw)} ({error})")


def decode_cbor(raw: str | bytes) -> Value | Difference:
    """Return the value of a CBOR binary frame."""
    if isinstance(raw, str):
        return Difference("", "a binary frame with CBOR", shorten(raw))
    try:
        return read_cbor(raw)
    except NotCbor as error:
        return Difference("", "CBOR", f"{raw[:40].hex()} ({error})")


def open_png(frame: Value) -> str | Difference:
    """Return the text in the image of a `png` op (PNG-01 to PNG-07)."""
    if not isinstance(frame, dict) or frame.get("op") != "png":
        return Difference("op", '"png"', as_text(frame))
    data = frame.get("data")
    if set(frame) != {"op", "data"} or not isinstance(data, str):
        return Difference("", "exactly op and data, both text (PNG-01, FRG-26)", ", ".join(sorted(frame)))
    try:
        picture = read_data(data)
    except NotPng as error:
        return Difference("data", "an RGB picture", str(error))
    text = picture.pixels.rstrip(b"\n")
    width = math.isqrt(len(text) // 3) or 1
    sides = (width, math.ceil(len(text) / 3 / width))
    if (picture.width, picture.height) != sides:
        return Difference(
            "data", f"{sides[0]} x {sides[1]} pixels (PNG-03)", f"{picture.width} x {picture.height}"
        )
    if not text.isascii():
        return Difference("data", "ASCII (PNG-05)", shorten(text.decode("utf-8", "replace")))
    return text.decode()


def first_fault_of_fragment(frame: Value, number: int, size: int) -> Difference | None:
    """Describe the first fault of a single fragment (FRG-02, FRG-21, FRG-23, FRG-24)."""
    if not isinstance(frame, dict) or frame.get("op") != "fragment":
        return Difference("op", '"fragment"', as_text(frame))
    if set(frame) != {"op", "id", "data", "num", "total"}:
        return Difference("", "exactly op, id, data, num and total", ", ".join(sorted(frame)))
    mark, data, num, total = frame["id"], frame["data"], frame["num"], frame["total"]
    if not isinstance(mark, str) or not mark:
        return Difference("id", "a string that is not empty (FRG-24)", as_text(mark))
    if not isinstance(total, int) or isinstance(total, bool) or total < 1:
        return Difference("total", "a positive integer (FRG-23)", as_text(total))
    if num != number or not isinstance(num, int) or isinstance(num, bool):
        return Difference("num", f"{number}, zero based and in order (FRG-02, FRG-28)", as_text(num))
    if not isinstance(data, str) or not 0 < len(data) <= size:
        return Difference("data", f"1 to {size} characters (FRG-21)", as_text(data))
    return None


def join_fragments(frames: Sequence[dict[str, Value]], size: int) -> str | Difference:
    """Return the joined text of valid fragments."""
    first = frames[0]
    for frame in frames:
        for key in ("id", "total"):
            if frame[key] != first[key]:
                return Difference(key, f"{as_text(first[key])} in all fragments", as_text(frame[key]))
    text = "".join(str(frame["data"]) for frame in frames)
    if len(text) <= size:
        return Difference(
            "", f"fragments only above {size} characters (FRG-21)", f"{len(text)} characters in all"
        )
    return text
