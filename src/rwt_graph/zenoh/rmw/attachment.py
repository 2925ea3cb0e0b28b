"""The attachment of every sample, request and reply: 33 bytes.

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

#: Bytes of an attachment.
SIZE = _LAYOUT.size

_GID_SIZE = 16

#: pack(sequence, stamp_ns, 16, gid): for the hot path, which calls nothing else.
pack = _LAYOUT.pack
unpack = _LAYOUT.unpack


class Attachment(NamedTuple):
    """The fields of an attachment, see the table."""

    sequence: int
    stamp_ns: int
    gid: bytes

    def encode(self) -> bytes:
        """The 33 bytes."""
        return pack(self.sequence, self.stamp_ns, _GID_SIZE, self.gid)


def decode(data: bytes) -> Attachment:
    """Read an attachment.

    Raises:
        WireError: not exactly 33 bytes, or the length byte is not 16; older ones (before 2025) were maps.
    """
    if len(data) != SIZE:
        raise WireError(f"an attachment of {len(data)} bytes; rmw_zenoh's has {SIZE}")
    sequence, stamp_ns, size, gid = unpack(data)
    if size != _GID_SIZE:
        raise WireError(f"an attachment whose GID has {size} bytes; rmw_zenoh's has {_GID_SIZE}")
    return Attachment(sequence, stamp_ns, gid)
