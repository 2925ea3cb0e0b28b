"""One vehicle on a link: its presence, its newest messages, and the protocols with it."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from typing import Final, TypeAlias

from rwt_mavlink.link.frames import AUTOPILOT, MavlinkMessage, dialect
from rwt_mavlink.link.links import Source
from rwt_mavlink.presence import LinkState, Presence
from rwt_mavlink.protocol.commands import CommandProtocol
from rwt_mavlink.protocol.errors import Rebooted, Unavailable
from rwt_mavlink.protocol.exchange import Exchange, Identity
from rwt_mavlink.protocol.missions import MissionProtocol
from rwt_mavlink.protocol.parameters import ParameterProtocol
from rwt_participant.timers import RobotClock

logger = logging.getLogger(__name__)

Listener: TypeAlias = Callable[[MavlinkMessage], object]

#: Types of MAV_TYPE that send heartbeats and are no vehicles.
_NO_VEHICLES: Final = {
    dialect.MAV_TYPE_GCS,
    dialect.MAV_TYPE_ONBOARD_CONTROLLER,
    dialect.MAV_TYPE_GIMBAL,
    dialect.MAV_TYPE_ADSB,
    dialect.MAV_TYPE_CAMERA,
}

#: Frames among which a duplicate is recognised; their numbers begin anew after 256.
_RECENT_FRAMES: Final = 64
#: Seconds without an attitude after which telemetry is requested.
_SILENT_SECONDS: Final = 3.0


class Vehicle:
    """Vehicle with one system id.

    Its attributes are the protocols, which any endpoint may use, and what was last heard of it.

    Args:
        clock: clock of timeouts.
        own: identity of this station.
        system: system id of the vehicle.
        timeout: seconds without a message after which the link is lost.
        stream_rate: rate of the telemetry to request, per second, if there is none; 0 for no request.
        send: sends a message to a source of the link.
        check: raises :exc:`Unavailable` if this station may not command any vehicle.

    Attributes:
        exchange: messages to and from its autopilot.
        commands: command protocol.
        missions: mission protocol.
        parameters: parameter protocol.
        presence: state of its link.
        heartbeat: last heartbeat of the autopilot; None before the first.
        latest: newest message of each type.
    """

    def __init__(
        self,
        clock: RobotClock,
        own: Identity,
        system: int,
        timeout: float,
        stream_rate: int,
        send: Callable[[MavlinkMessage, Source], None],
        check: Callable[[], None],
    ) -> None:
        self._stream_rate = stream_rate
        self._telemetry_at = 0.0
        self._recent: deque[bytes] = deque(maxlen=_RECENT_FRAMES)
        self._send_to = send
        self._check_station = check
        self.exchange = Exchange(clock, own, Identity(system, AUTOPILOT), self._send, self._check)
        self.commands = CommandProtocol(self.exchange)
        self.missions = MissionProtocol(self.exchange)
        self.parameters = ParameterProtocol(self.exchange, lambda: self.is_px4)
        self.presence = Presence(timeout)
        self.heartbeat: MavlinkMessage | None = None
        self.latest: dict[str, MavlinkMessage] = {}
        self._listeners: dict[str, list[Listener]] = {}
        self.on("PARAM_VALUE", self.parameters.receive)
        self._on_connected: list[Callable[[], None]] = []
        self._on_lost: list[Callable[[], None]] = []

    # -- state -----------------------------------------------------------------------------------------------

    @property
    def autopilot(self) -> int:
        """Number of MAV_AUTOPILOT; that of an unknown one before the first heartbeat."""
        return int(self.heartbeat.autopilot) if self.heartbeat is not None else dialect.MAV_AUTOPILOT_GENERIC

    @property
    def type(self) -> int:
        """Number of MAV_TYPE."""
        return int(self.heartbeat.type) if self.heartbeat is not None else dialect.MAV_TYPE_GENERIC

    @property
    def is_px4(self) -> bool:
        """True if its autopilot is PX4."""
        return self.autopilot == int(dialect.MAV_AUTOPILOT_PX4)

    @property
    def is_connected(self) -> bool:
        """True while heartbeats arrive."""
        return self.presence.state is LinkState.CONNECTED

    @property
    def unavailable(self) -> str:
        """Reason why the vehicle cannot be commanded; empty if it can."""
        system, now = self.exchange.target.system, self.exchange.clock.monotonic()
        if self.presence.state is LinkState.SILENT:
            return f"no vehicle with the system id {system} has been heard"
        if not self.is_connected:
            silent = now - self.presence.heard_at
            return f"the link to the vehicle is lost: nothing was heard for {silent:.0f} s"
        if self.presence.has_clash(now):
            return f"two vehicles use the system id {system}: set another SYSID_THISMAV or MAV_SYS_ID"
        return ""

    # -- messages --------------------------------------------------------------------------------------------

    def on(self, type: str, listener: Listener) -> None:
        """Call `listener` with each message of a type, after it became the newest."""
        self._listeners.setdefault(type, []).append(listener)

    def on_connected(self, call: Callable[[], None]) -> None:
        """Call `call` when the vehicle is heard for the first time, again, or has restarted."""
        self._on_connected.append(call)

    def on_lost(self, call: Callable[[], None]) -> None:
        """Call `call` when the link is lost."""
        self._on_lost.append(call)

    def receive(self, message: MavlinkMessage, source: Source) -> None:
        """Take a message with the vehicle's system id. One that arrives twice is taken once."""
        frame = bytes(message.get_msgbuf())
        if frame in self._recent:  # Frames are numbered, so no other one is the same.
            return
        self._recent.append(frame)
        type, now = message.get_type(), self.exchange.clock.monotonic()
        if type == "HEARTBEAT":
            if message.autopilot == dialect.MAV_AUTOPILOT_INVALID or message.type in _NO_VEHICLES:
                return  # A camera or another component of the vehicle, or a station with its id.
            self.exchange.target = Identity(message.get_srcSystem(), message.get_srcComponent())
            self.heartbeat = message
            if self.presence.on_heartbeat(source, now):
                _call(self._on_connected)
        elif message.get_srcComponent() != self.exchange.target.component:
            return
        if self.presence.on_message(message, now):
            self.exchange.interrupt(Rebooted("the vehicle restarted before it answered"))
            _call(self._on_connected)
        if type == "ATTITUDE" or type == "ATTITUDE_QUATERNION":
            self._telemetry_at = now
        self.latest[type] = message
        self.exchange.deliver(message)
        for listener in self._listeners.get(type, ()):
            try:
                listener(message)
            except Exception:  # A message of the network must not end the link.
                logger.exception("a listener failed on %s", type)

    def tick(self) -> None:
        """Note that time has passed; called about once a second."""
        now = self.exchange.clock.monotonic()
        if self.presence.check(now):
            self.exchange.interrupt(Unavailable(self.unavailable))
            _call(self._on_lost)
        elif self.is_connected and self._stream_rate and now - self._telemetry_at > _SILENT_SECONDS:
            self.request_streams(dialect.MAV_DATA_STREAM_ALL, self._stream_rate, True)

    def request_streams(self, stream: int, rate: int, is_on: bool) -> None:
        """Request telemetry of a kind at a rate; autopilots do not confirm it."""
        target = self.exchange.target
        self.exchange.send(
            dialect.MAVLink_request_data_stream_message(
                target.system, target.component, stream, rate, int(is_on)
            )
        )

    def _check(self) -> None:
        self._check_station()
        if reason := self.unavailable:
            raise Unavailable(reason)

    def _send(self, message: MavlinkMessage) -> None:
        if self.presence.source is not None:
            self._send_to(message, self.presence.source)


def _call(calls: list[Callable[[], None]]) -> None:
    for call in calls:
        call()
