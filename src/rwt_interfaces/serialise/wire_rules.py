"""Rules of the packed forms, CDR and ROS 1's: consecutive fields with length heads and without names.

Both are little-endian here.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from typing import Final

from rwt_interfaces import field_types
from rwt_interfaces.field_types import FieldType


@dataclass(frozen=True, slots=True)
class WireRules:
    """Rules of one packed form, CDR or ROS 1's.

    Attributes:
        header: bytes before the message; its last two bytes are options, all unset.
        aligned: True if numbers are aligned to their size.
        terminated: True if strings end with a NUL, which their length counts.
        filler: bytes of a message without fields.
        followed: True if any bytes may follow a message.
    """

    header: bytes
    aligned: bool
    terminated: bool
    filler: bytes
    followed: bool = False

    def length_head(self, length: int, is_text: bool) -> bytes:
        """Return the length before a string or octets of that many bytes; padding precedes it."""
        return LENGTH.pack(length + (is_text and self.terminated))


#: The length before what varies in length.
LENGTH = struct.Struct("<I")
#: Letter of a message without fields, a padding byte in :mod:`struct`.
FILLED = "x"

CDR: Final = WireRules(header=b"\0\1\0\0", aligned=True, terminated=True, filler=b"\0")
"""XCDR version 1 with its encapsulation header. Alignment counts from after the header.

The standard leaves `wstring` open; this is the form of Fast CDR, ROS 2's default: units of UTF-16 in four
bytes each, counted by the length, without byte order mark and closing zero. CycloneDDS writes two bytes.
"""

FOLLOWED_CDR: Final = replace(CDR, followed=True)
"""CDR as Fast DDS's `rmw_serialize` writes it: as long as its estimate, which is too long for some types."""

ROS1: Final = WireRules(header=b"", aligned=False, terminated=False, filler=b"")
"""The body of a TCPROS message, without its length prefix."""

RULES: Final = {"cdr": CDR, "ros1": ROS1}
"""Rules by name of the form."""


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
