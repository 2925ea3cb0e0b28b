"""Settings of MAVLink: the table `[mavlink]`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from rwt.access.settings import Seconds, Table
from rwt_mavlink.link.addresses import parse_link

SystemId = Annotated[int, Field(ge=1, le=255)]
"""Id of a vehicle or a ground station; 0 addresses all of them."""

#: Namespaces of vehicles, if several are served and none is set.
_OF_SEVERAL = "/uav{system}/mavros"


def _check_link(text: str) -> str:
    if text:
        parse_link(text)
    return text


def _check_namespace(text: str) -> str:
    try:
        text.format(system=1)
    except (IndexError, KeyError, ValueError) as error:
        raise ValueError(f"{text!r} may only contain the field {{system}}") from error
    return text


class MavlinkSettings(Table):
    """Vehicles of ArduPilot and PX4. The table `[mavlink]`."""

    link: Annotated[str, AfterValidator(_check_link)] = Field(
        "",
        description="`udp://HOST:PORT` to listen, `udp://@HOST:PORT` to send first, `tcp://HOST:PORT` or"
        " `serial://DEVICE:BAUD`; empty: off",
    )
    systems: tuple[SystemId, ...] = Field(
        (1,), min_length=1, max_length=32, description="system ids of the vehicles; others are ignored"
    )
    namespace: Annotated[str, AfterValidator(_check_namespace)] = Field(
        "", description="prefix of names; by default /mavros, or /uav{system}/mavros for several vehicles"
    )
    system: SystemId = Field(255, description="own system id; autopilots accept overrides of one id only")
    component: SystemId = Field(191, description="own component id, different from that of other stations")
    heartbeat: bool = Field(
        True, description="send heartbeats, without which an autopilot may start its link-loss failsafe"
    )
    stream_rate: int = Field(4, ge=0, le=50, description="messages per second to request; 0 requests none")
    timeout: Seconds = Field(5.0, description="seconds without a message after which the link is lost")
    dead_man: float = Field(
        0.5, ge=0.1, le=2.0, description="seconds without a velocity or override after which it is stopped"
    )
    velocity_frame: Literal["local", "body"] = Field(
        "local", description="axes of velocities: east, north, up, or forward, left, up of the vehicle"
    )

    def namespace_of(self, system: int) -> str:
        """Return the namespace of a vehicle."""
        usual = "/mavros" if len(self.systems) == 1 else _OF_SEVERAL
        return "/" + (self.namespace or usual).format(system=system).strip("/")
