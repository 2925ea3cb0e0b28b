"""Where the long arrays of a large JSON text are, and where they may be cut between two items.

Nothing here proves anything: a place that is wrong leaves a piece that is not JSON, or an array that is no
field's, and whoever decodes the pieces finds out. Why pieces that are JSON stand for the whole array: the
first begins with its first item; an array of items that is valid ends where the text itself would end it; and
behind the comma after it the next piece begins with an item again.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final, NamedTuple

from rwt_interfaces.serialise.long_strings import LARGE, Steps

_MOST_BRACKETS: Final = 64
"""Brackets that are looked at in search of long arrays, or of an end, in one step."""
_WINDOW: Final = 1 << 18
"""Bytes that are searched in one step."""
_MOST_SPACE: Final = 1024
"""Bytes before a bracket among which a brace is looked for."""
LONG_ITEM: Final = 4
"""How many times longer than a piece an item is that is cut by itself."""
_SPACE: Final = rb"[ \t\r\n]*+"
_BEGIN = re.compile(
    rb"\[(" + _SPACE + rb")(?:([-0-9NInatf])|(\")|(\{" + _SPACE + rb'"[^"\\]{1,64}"' + _SPACE + rb":))"
)
_END = re.compile(rb"\}" + _SPACE + rb"\]")
# Each turn of the outer loop is atomic: Python before 3.11.5 does not go back from one that fails halfway.
_TEXTS = re.compile(rb'(?>"[^"\\]*+(?:\\.[^"\\]*+)*+"' + _SPACE + rb"," + _SPACE + rb")*+", re.DOTALL)
_AFTER_TEXT = re.compile(_SPACE + rb"([,\]])")


class Region(NamedTuple):
    """Where an array is in a text.

    Attributes:
        begin, end: of the array, brackets included.
        separators: of an array of objects: before one of these an item ends with a brace, and behind the
            comma the next begins; none where items are single numbers or words.
        cuts: of an array of texts: the commas between the pieces; None of another one.
    """

    begin: int
    end: int
    separators: tuple[bytes, ...] = ()
    cuts: tuple[int, ...] | None = None


def regions(data: bytes, size: int) -> Steps[list[Region]]:
    """The arrays of a text that are long, in order; those within one of them are left out.

    Args:
        data: the text.
        size: bytes of a piece of an array of texts.
    """
    found = []
    at = data.find(b"[")
    for _ in range(_MOST_BRACKETS):
        if at < 0:
            break
        region = yield from _region(data, at, size)
        if region is not None and region.end - at >= LARGE:
            found.append(region)
            at = region.end
        at = data.find(b"[", at + 1)
    return found


def _region(data: bytes, begin: int, size: int) -> Steps[Region | None]:
    first = _BEGIN.match(data, begin)
    if first is None:
        return None
    if first[2]:
        return Region(begin, data.find(b"]", begin) + 1)
    if first[3]:
        return (yield from _region_of_texts(data, begin, first.start(3), size))
    end = yield from _end_of_objects(data, begin)
    between = {b"", b" ", first[1]}
    return Region(begin, end, tuple(b"}," + space + first[4] for space in sorted(between)))


def _end_of_objects(data: bytes, begin: int) -> Steps[int]:
    """Behind the bracket that closes an array of objects, as if no text held a bracket; 0 if there is
    none."""
    depth, at, tries = 1, begin + 1, 0
    while True:
        first = data.find(b"]", at)
        if first < 0:
            return 0
        # From one bracket up to another, so that no end lies across two windows.
        near = max(at, first - _MOST_SPACE)
        stop = data.rfind(b"]", first, first + _WINDOW) + 1
        end = _END.search(data, near, stop)
        reached = stop if end is None else end.end()
        depth += yield from _nesting(data, at, reached)
        at = reached
        if end is not None and depth <= 0:
            return at
        tries += 1
        if end is None or tries % _MOST_BRACKETS == 0:
            yield


def _nesting(data: bytes, begin: int, end: int) -> Steps[int]:
    """How many more brackets open than close between two places, as if no text held one."""
    depth = 0
    for start in range(begin, end, _WINDOW):
        if start > begin:
            yield
        stop = min(start + _WINDOW, end)
        depth += data.count(b"[", start, stop) - data.count(b"]", start, stop)
    return depth


def _region_of_texts(data: bytes, begin: int, at: int, size: int) -> Steps[Region | None]:
    cuts = []
    while True:
        whole = _TEXTS.match(data, at, at + size)
        if whole is not None and whole.end() > at:
            at = whole.end()
            # The pattern ends behind the comma, and what space there is.
            cuts.append(data.rfind(b",", 0, at))
            yield
            continue
        if data[at : at + 1] != b'"':
            return None
        end = yield from _end_of_text(data, at)
        after = _AFTER_TEXT.match(data, end) if end else None
        if after is None:
            return None
        if after[1] == b"]":
            return Region(begin, after.end(), (), tuple(cuts))
        if after.start(1) - (cuts[-1] if cuts else begin) >= size:
            cuts.append(after.start(1))
            yield
        at = after.end()
        while data[at : at + 1].isspace():
            at += 1


def _end_of_text(data: bytes, begin: int) -> Steps[int]:
    """Behind the quote that ends the text which begins with one; 0 if there is none."""
    at, tries = begin + 1, 0
    while True:
        place = data.find(b'"', at)
        if place < 0:
            return 0
        if not _is_escaped(data, place, at):
            return place + 1
        at = place + 1
        tries += 1
        if tries % 1024 == 0:
            yield


def _is_escaped(data: bytes, place: int, begin: int) -> bool:
    """Whether an odd number of backslashes stands before a place, back to `begin`."""
    count = 0
    while place > begin:
        part = data[max(begin, place - 4096) : place]
        here = len(part) - len(part.rstrip(b"\\"))
        count += here
        if here < len(part):
            break
        place -= here
    return count % 2 == 1


class Pieces:
    """From where to where each piece of an array goes, and None where a step has passed without one.

    Attributes:
        size: bytes of the pieces to come; each has a little more, up to the end of an item. An object that is
            much longer is a piece by itself. Where texts are cut was decided before.

    Args:
        data: the text.
        region: the array.
        size: see above.
    """

    def __init__(self, data: bytes, region: Region, size: int) -> None:
        self._data = data
        self._region = region
        self.size = size

    def __iter__(self) -> Iterator[tuple[int, int] | None]:
        data, region = self._data, self._region
        start, last = region.begin + 1, region.end - 1
        if region.cuts is not None:
            for cut in (*region.cuts, last):
                yield start, cut
                start = cut + 1
            return
        while start <= last:
            size = self.size
            if region.separators:
                stop = yield from _between_objects(data, region, start, start + size, last)
            else:
                stop = data.find(b",", start + size, last)
            if stop < 0:
                stop = last
            if region.separators and stop - start > LONG_ITEM * size:
                before = _before_long_item(data, region, start, start + size)
                if before > 0:
                    yield start, before
                    start = before + 1
            yield start, stop
            start = stop + 1


def _between_objects(data: bytes, region: Region, start: int, at: int, last: int) -> Steps[int]:
    """The first comma between two items behind `at`, of those from `start` on; -1 if there is none."""
    depth, counted, tries = 0, start, 0
    while at < last:
        stop = min(at + _WINDOW, last)
        places = [place for each in region.separators if (place := data.find(each, at, stop)) >= 0]
        place = min(places, default=stop)
        depth += data.count(b"[", counted, place) - data.count(b"]", counted, place)
        counted = place
        if depth:
            # Within an array of an item: there is no end before that ends.
            at = data.find(b"]", place, last)
            if at < 0:
                return -1
        elif places:
            return place + 1
        else:
            # What lies across two windows is found from the next.
            at = max(stop - 128, at + 1) if stop < last else last
        tries += 1
        if tries % _MOST_BRACKETS == 0 or place - start > _WINDOW:
            yield
    return -1


def _before_long_item(data: bytes, region: Region, start: int, stop: int) -> int:
    """The last comma between two items before `stop`; 0 if there is none."""
    for _ in range(_MOST_BRACKETS):
        place = max(data.rfind(each, start, stop) for each in region.separators)
        if place < 0:
            return 0
        if data.count(b"[", start, place) == data.count(b"]", start, place):
            return place + 1
        stop = data.rfind(b"[", start, place)
    return 0
