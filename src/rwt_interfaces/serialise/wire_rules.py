"""What CDR and ROS 1's own form have in common: fields one after another, lengths before what varies, no
names.

They differ in alignment, in how strings end and in what an empty message is: a :class:`Rules` says so. Both
are little-endian here.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from rwt_interfaces import field_types as shapes
from rwt_interfaces.field_types import Shape


@dataclass(frozen=True, slots=True)
class Rules:
    """How one packed form differs from the other.

    Attributes:
        aligned: whether a number begins at a multiple of its size.
        terminated: whether a string ends with a zero byte, which its length counts.
        filler: what stands for a message without fields.
    """

    aligned: bool
    terminated: bool
    filler: bytes


#: The length before what varies in length.
LENGTH = struct.Struct("<I")
#: The letter of a message without fields: :mod:`struct` makes it a zero byte that no value stands for.
FILLED = "x"


def letters(shape: Shape | None) -> str:
    """The letters of a leaf of fixed size in :mod:`struct`; empty for any other."""
    match shape:
        case None:
            return FILLED
        case shapes.Bool():
            return "?"
        case shapes.Int() | shapes.Float():
            return shape.code
        case shapes.Time():
            return shape.seconds.code + shape.nanoseconds.code
        case _:
            return ""


def gap(offset: int, size: int, aligned: bool) -> int:
    """How many bytes of padding go before a number of that size at that offset."""
    return -offset % size if aligned else 0
