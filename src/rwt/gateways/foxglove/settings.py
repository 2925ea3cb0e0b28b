"""Settings of the Foxglove gateway."""

from __future__ import annotations

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
