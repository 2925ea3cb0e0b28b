"""What CDR and ROS 1's own form have in common: fields one after another, lengths before what varies, no
names.

They differ in alignment, in how strings end and in what an empty message is: a :class:`WireRules` says so.
Both are little-endian here.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

from rwt_interfaces import field_types
from rwt_interfaces.field_types import FieldType


@dataclass(frozen=True, slots=True)
class WireRules:
    """The rules of one packed form, CDR or ROS 1's own.

    Attributes:
        header: what stands before the message; of two bytes of options at its end, none is set.
        aligned: whether a number begins at a multiple of its size.
        terminated: whether a string ends with a zero byte, which its length counts.
        filler: what stands for a message without fields.
    """

    header: bytes
    aligned: bool
    terminated: bool
    filler: bytes

    def length_head(self, length: int, is_text: bool) -> bytes:
        """Return the length before a string or octets of that many bytes; padding precedes it."""
        return LENGTH.pack(length + (is_text and self.terminated))


#: The length before what varies in length.
LENGTH = struct.Struct("<I")
#: The letter of a message without fields: :mod:`struct` makes it a zero byte that no value stands for.
FILLED = "x"

CDR: Final = WireRules(header=b"\0\1\0\0", aligned=True, terminated=True, filler=b"\0")
"""XCDR version 1 with its encapsulation header. Alignment counts from after the header."""

ROS1: Final = WireRules(header=b"", aligned=False, terminated=False, filler=b"")
"""The body of a TCPROS message, without its length prefix."""


def letters(field_type: FieldType | None) -> str:
    """Return the letters of a leaf of fixed size in :mod:`struct`; empty for any other."""
    match field_type:
        case None:
            return FILLED
        case field_types.Bool():
            return "?"
        case field_types.Int() | field_types.Float():
            return field_type.code
        case field_types.Time():
            return field_type.seconds.code + field_type.nanoseconds.code
        case _:
            return ""


def gap(offset: int, size: int, aligned: bool) -> int:
    """Return the number of padding bytes before a number of that size at that offset."""
    return -offset % size if aligned else 0
