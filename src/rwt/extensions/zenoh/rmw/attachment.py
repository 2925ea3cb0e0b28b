"""Attachment of every sample, request and reply: 33 bytes.

====== ====== =========================================================================
offset length field
====== ====== =========================================================================
0      8      sequence number, int64, little-endian
8      8      time of publishing in nanoseconds since the epoch, int64, little-endian
16     1      length of the GID, always 16
17     16     GID: of the publisher; of the client, in a request and in its reply
====== ====== =========================================================================
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from rwt_graph.errors import WireError

_LAYOUT = struct.Struct("<qqB16s")

#: Size of an attachment in bytes.
SIZE = _LAYOUT.size

_GID_SIZE = 16

#: pack(sequence, stamp_ns, 16, gid): the hot path calls only this.
pack = _LAYOUT.pack
unpack = _LAYOUT.unpack


class Attachment(NamedTuple):
    """Fields of an attachment; see the table."""

    sequence: int
    stamp_ns: int
    gid: bytes

    def encode(self) -> bytes:
        return pack(self.sequence, self.stamp_ns, _GID_SIZE, self.gid)


def decode(data: bytes) -> Attachment:
    """Decode an attachment.

    Raises:
        WireError: the size is not 33 bytes, or the length byte is not 16; versions before 2025 used maps.
    """
    if len(data) != SIZE:
        raise WireError(f"an attachment of {len(data)} bytes; rmw_zenoh's has {SIZE}")
    sequence, stamp_ns, size, gid = unpack(data)
    if size != _GID_SIZE:
        raise WireError(f"an attachment whose GID has {size} bytes; rmw_zenoh's has {_GID_SIZE}")
    return Attachment(sequence, stamp_ns, gid)
