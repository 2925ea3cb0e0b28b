"""Objects that an object holds: a measure of memory that needs none of its private names."""

from __future__ import annotations

import gc
from types import CodeType, FunctionType, ModuleType
from typing import Final

_SHARED: Final = (type, ModuleType, CodeType, FunctionType)
"""Objects that all of a program shares, and through which everything else can be reached."""


def held(*roots: object, kind: type = object) -> int:
    """Return the number of objects of a kind that can be reached from the roots."""
    ahead: list[object] = list(roots)
    seen: dict[int, object] = {}
    while ahead:
        each = ahead.pop()
        if id(each) not in seen and not isinstance(each, _SHARED):
            seen[id(each)] = each
            ahead += gc.get_referents(each)
    return sum(isinstance(each, kind) for each in seen.values())
