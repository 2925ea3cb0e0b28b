"""Settings of the Foxglove gateway."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from rwt.access.settings import MIB, Bytes, Count, Table


class FoxgloveSettings(Table):
    """Foxglove's WebSocket protocol, on the same port."""

    asset_bytes: Annotated[
        Bytes, Field(description="largest asset, such as a mesh, that a client may fetch")
    ] = 64 * MIB
    waiting_assets: Annotated[Count, Field(description="pending asset requests per client")] = 256
    parameter_names: Annotated[
        Count, Field(description="parameters that one client may request at once or watch")
    ] = 1000
    time_hz: Annotated[
        float,
        Field(gt=0, le=1000, description="rate in Hz at which simulated time is sent to clients"),
    ] = 20.0
