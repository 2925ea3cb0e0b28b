"""Declaration of the service `mavlink`."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from rwt.declarations import ServiceContext, ServicePart
from rwt.settings.models import Settings
from rwt_mavlink.settings import MavlinkSettings


def _check(settings: Settings, own: MavlinkSettings) -> None:
    if own.link and settings.distro == "noetic":
        raise ValueError("`mavlink`: the types of mavros are those of ROS 2; set `distro` to jazzy or newer")


@asynccontextmanager
async def _run(context: ServiceContext, settings: MavlinkSettings) -> AsyncIterator[None]:
    from rwt_mavlink.station import Station  # Imports pymavlink.

    async with Station(context.graph, settings):
        yield


PART = ServicePart(
    summary="vehicles of ArduPilot and PX4 over MAVLink, with the names of mavros",
    settings=MavlinkSettings,
    check=_check,
    is_on=lambda settings: bool(settings.link),
    run=_run,
)
