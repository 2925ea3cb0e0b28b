"""Forms in which a message may arrive or be made.

| source | message |
|---|---|
| `bytes`, `memoryview` | exact JSON, as received or joined |
| :class:`CutText` | exact JSON as received, most of which is one long string |
| :class:`SplitText` | JSON with exact long arrays, completed around them |
| :class:`SplicedMessage` | decoded message, most of which is one long string or octets |
| :class:`Relayed` | serialised by a trusted program, and not checked yet |
| `msgspec.Struct` | decoded message: of the type's own Struct or of `MessageJson.sendable` |
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import msgspec

from rwt_interfaces.serialise.long_strings import CutText, Parts, RawText
from rwt_interfaces.serialise.splice import SplicedMessage

__all__ = ["BinaryForm", "CutText", "Relayed", "Source", "SplicedMessage", "SplitText"]

BinaryForm = Literal["cbor", "cdr", "ros1"]


class SplitText(NamedTuple):
    """JSON text in parts, so that its long arrays are not copied; not empty."""

    parts: Parts


class Relayed(NamedTuple):
    """Message in the serialisation of its type's distribution, as another program sent it."""

    form: BinaryForm
    data: RawText


Source = RawText | CutText | SplitText | SplicedMessage | Relayed | msgspec.Struct
"""Form that holds a whole message by itself."""
