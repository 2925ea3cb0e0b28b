"""Settings of the Foxglove gateway."""

from __future__ import annotations

from pydantic import Field

from rwt.access.settings import MIB, Bytes, Count, Table


class FoxgloveSettings(Table):
    """Foxglove's WebSocket protocol, on the same port."""

    asset_bytes: Bytes = Field(64 * MIB, description="largest asset, such as a mesh, that a client may fetch")
    waiting_assets: Count = Field(256, description="pending asset requests per client")
    parameter_names: Count = Field(
        1000, description="parameters that one client may request at once or watch"
    )
    time_hz: float = Field(
        20.0, gt=0, le=1000, description="rate in Hz at which simulated time is sent to clients"
    )
