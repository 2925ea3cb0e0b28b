"""What an operator can set about Foxglove's protocol, and the bounds that clients of all protocols have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from rwt.access.settings import MIB, Bytes, Count, Table


class FoxgloveSettings(Table):
    """Foxglove's WebSocket protocol, on the same port."""

    asset_bytes: Annotated[
        Bytes, Field(description="largest file of a package, such as a mesh, that a client may fetch")
    ] = 64 * MIB
    waiting_assets: Annotated[
        Count, Field(description="files that one client may have asked for and not yet got")
    ] = 256
    parameter_names: Annotated[
        Count, Field(description="parameters that one client may ask for at once, or watch")
    ] = 1000
    time_hz: Annotated[
        float,
        Field(
            gt=0, le=1000, description="times a second that clients are told a time that is not the wall's"
        ),
    ] = 20.0


@dataclass(frozen=True, slots=True)
class Bounds:
    """What one client may send and is sent, as for clients of every protocol.

    Attributes:
        message_bytes: of the largest message to a client (`limits.outgoing_message_bytes`).
        structure: brackets of one message in JSON that lacks a field (`limits.structure_bytes`).
        messages_per_second: that a client may send in the long run; 0 for any number.
        messages_burst: that it may send at once before the rate counts.
        call_timeout: seconds that a service call may take; None for ever.
    """

    message_bytes: int = 256 * MIB
    structure: int = 256 * 1024
    messages_per_second: int = 0
    messages_burst: int = 20_000
    call_timeout: float | None = 5.0
