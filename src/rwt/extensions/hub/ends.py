"""The two ends that a hub joins: the connection of a client, and a stream of an uplink."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import partial
from typing import TYPE_CHECKING, ClassVar, Final, Literal

import anyio

from rwt.extensions.hub.uplink.frames import Refusal
from rwt.extensions.hub.uplink.openings import BadOpening, check_headers
from rwt.extensions.hub.uplink.streams import Stream
from rwt.gateways.early_look import MAX_STOP_BYTES, may_name_stop
from rwt_protocol.frames import Frame
from rwt_transports.api import FlowControl
from rwt_transports.endpoint import Sink
from rwt_transports.errors import Refused
from rwt_transports.http.addresses import holder_of
from rwt_transports.http.routes import is_local
from rwt_transports.limits import MIB
from rwt_transports.scheduler import MESSAGES
from rwt_transports.shared_pool import PoolRow, Share, SharedPool
from rwt_transports.websocket.close_codes import (
    GOING_AWAY,
    POLICY,
    SERVICE_RESTART,
    TRY_AGAIN_LATER,
    may_travel,
)

if TYPE_CHECKING:
    from rwt.extensions.hub.hub import DialedRobot, Hub

PASS_BYTES: Final = 256 * 1024
"""Bytes to pass on before waiting until the other side has taken them."""

ADDRESS_BYTES: Final = 64 * MIB
"""Default limit of waiting bytes for the clients of one address."""

TOTAL_FACTOR: Final = 4
"""Limit for all addresses together, as a multiple of the limit of one."""

PATIENCE_SECONDS: Final = 10.0
"""Maximum time that a client waits for its robot's answer."""

STOP_SECONDS: Final = 1.0
"""Minimum time between two messages of a client that go ahead of all others, because they may press the
emergency stop. The robot decides whether they do."""


WAITING_BYTES: Final = PoolRow("waiting bytes of a hub", "--waiting-bytes", "waiting bytes")
CLIENTS: Final = PoolRow("clients of a hub", "--connections", "connections of clients")
LINKS: Final = PoolRow("links of a node", "--links", "robots of other nodes")


class WaitingBytes:
    """Counter of waiting bytes; above the limit, it closes the connection that has waited for longest.

    A connection is held back once 256 KiB of it wait. What counts is therefore large messages to a side that
    does not read.

    Args:
        most: maximum number of waiting bytes for the clients of one address, in both directions. Local
            addresses have no limit of their own; all addresses together share four times as much.
    """

    def __init__(self, most: int = ADDRESS_BYTES) -> None:
        self._most = most
        self._pool = SharedPool(WAITING_BYTES, TOTAL_FACTOR * most)
        self._shares: dict[HubEnd, Share] = {}

    @property
    def total(self) -> int:
        """Waiting bytes of all connections."""
        return self._pool.used

    def take(self, end: HubEnd, size: int) -> None:
        """Add `size` waiting bytes of a connection."""
        share = self._shares.get(end)
        if share is None:
            share = self._pool.take(holder_of(end.address), partial(self._cut, end), 0)
            self._shares[end] = share
        self._pool.resize(share, share.amount + size)
        held = self._pool.held(share.holder)
        if (held > self._most and not is_local(end.address)) or self._pool.used > self._pool.capacity:
            self._pool.end_oldest(share.holder)

    def give_back(self, end: HubEnd) -> None:
        """Clear the waiting bytes of a connection; idempotent."""
        share = self._shares.pop(end, None)
        if share is not None:
            self._pool.release(share)

    def _cut(self, end: HubEnd, reason: str) -> None:
        del self._shares[end]
        end.cut(reason)


class HubEnd(ABC):
    """One of two ends that the hub joins.

    Reading stops while the other side has not taken what was passed on (``_is_full``), and once this end has
    used its share of a turn of the event loop, until another turn (``_is_late``).

    Attributes:
        address: address of the client, to which both ends are charged.
    """

    holds_wire: ClassVar[Literal[True]] = True

    def __init__(self, hub: Hub, robot: DialedRobot, sink: Sink, address: str) -> None:
        self.address = address
        self.hub = hub
        self.robot = robot
        self.sink = sink
        self.flow_control: FlowControl | None = None
        self.other: HubEnd | None = None
        self._passed = 0
        self._is_full = self._is_late = False
        self._received = -1
        self._turn_began = 0.0

    def set_flow_control(self, flow_control: FlowControl) -> None:
        """Set the flow control of this end. Called before it opens."""
        self.flow_control = flow_control

    def receive(self, data: bytes, binary: bool) -> None:
        """Pass a message on."""
        scheduler = self.hub.scheduler
        now = scheduler.monotonic()
        if self.sink.received != self._received:  # Another read, and therefore another turn.
            self._received = self.sink.received
            self._turn_began = now
        if self.other is not None:
            self._pass_on(Frame(data, binary=binary), self.other, now)
        used = scheduler.monotonic() - self._turn_began
        must_wait = used > MESSAGES.share or scheduler.is_full
        if must_wait and not self._is_late and self.flow_control is not None:
            scheduler.note(used)
            self._is_late = True
            self.flow_control.pause()
            scheduler.wait(self._go_on)

    def _go_on(self) -> None:
        self._is_late = False
        self._turn_began = self.hub.scheduler.monotonic()
        self._resume()

    def _resume(self) -> None:
        """Read on, unless there is another reason to wait."""
        if self.flow_control is not None and not (self._is_late or self._is_full):
            self.flow_control.resume()

    def _pass_on(self, frame: Frame, other: HubEnd, now: float) -> None:
        self.send_to(other, frame, now)
        self._passed += frame.size
        self.hub.bytes += frame.size
        if self._passed >= PASS_BYTES and self.flow_control is not None and other.flow_control is not None:
            passed, self._passed = self._passed, 0
            self._is_full = True
            self.flow_control.pause()
            other.flow_control.when_empty(self._taken)
            self.hub.waiting.take(self, passed)

    def send_to(self, other: HubEnd, frame: Frame, now: float) -> None:
        """Send a message to the other end."""
        other.sink.send(frame)

    def _taken(self) -> None:
        self.hub.waiting.give_back(self)
        self._is_full = False
        self._resume()

    def cut(self, reason: str) -> None:
        """Close both ends: too many bytes wait."""
        self.closed(POLICY, reason)
        self.hang_up(POLICY, reason)

    def closed(self, code: int, reason: str) -> None:
        """End the other end as well; the waiting bytes of both no longer count."""
        self.hub.waiting.give_back(self)
        other, self.other = self.other, None
        if other is not None:
            self.hub.waiting.give_back(other)
            other.other = None
            other.end(code, reason)

    def hang_up(self, code: int, reason: str) -> None:
        """Close this end, even if it is held back."""
        self.sink.close(code, reason)
        if self.flow_control is not None:
            # Resume reading, to receive the reply to the close. Messages are dropped now.
            self.flow_control.resume()

    @abstractmethod
    def end(self, code: int, reason: str) -> None:
        """Close this end because the other has gone."""


class RobotEnd(HubEnd):
    """Stream to a robot."""

    def __init__(self, hub: Hub, robot: DialedRobot, stream: Stream, address: str) -> None:
        super().__init__(hub, robot, stream, address)
        self.stream = stream

    def end(self, code: int, reason: str) -> None:
        self.hang_up(code if may_travel(code) else GOING_AWAY, reason)


class ClientEnd(HubEnd):
    """Connection of a client.

    Raises:
        PoolFull: all places for clients are taken, and no client has more than this one would have.
    """

    def __init__(self, hub: Hub, robot: DialedRobot, sink: Sink, address: str) -> None:
        super().__init__(hub, robot, sink, address)
        self._stop_sent = -STOP_SECONDS
        self._place = hub.places.take(holder_of(address), self._displace)

    def _displace(self, reason: str) -> None:
        self.closed(TRY_AGAIN_LATER, reason)
        self.hang_up(TRY_AGAIN_LATER, reason)

    def closed(self, code: int, reason: str) -> None:
        self.hub.places.release(self._place)
        super().closed(code, reason)

    def send_to(self, other: HubEnd, frame: Frame, now: float) -> None:
        """Send a message to the robot, or end the client whose message cannot be delivered now."""
        if not self.robot.is_reachable:
            # A command that arrives late is worse than one that does not arrive.
            reason = f"the robot {self.robot.name} is unreachable: the message was not delivered"
            self.closed(SERVICE_RESTART, reason)
            self.hang_up(SERVICE_RESTART, reason)
        elif (
            isinstance(other, RobotEnd)
            and frame.size <= MAX_STOP_BYTES
            and now - self._stop_sent >= STOP_SECONDS
            and may_name_stop(frame.data)
        ):
            self._stop_sent = now
            other.stream.send_stop(frame)
        else:
            super().send_to(other, frame, now)

    def end(self, code: int, reason: str) -> None:
        if may_travel(code):
            self.hang_up(code, reason)
        else:
            self.hang_up(SERVICE_RESTART, f"the robot {self.robot.name} is gone: {reason}")


class Admission:
    """Endpoint of a stream whose client the robot has not admitted yet. Messages of the robot wait."""

    holds_wire: ClassVar[Literal[True]] = True

    def __init__(self, stream: Stream, robot: str) -> None:
        self._robot = robot
        self._answered = anyio.Event()
        self._refused: Refused | None = None
        stream.on_admission = self._answer
        stream.begin(self)
        stream.pause()

    async def granted(self) -> None:
        """Wait for the robot's answer.

        Raises:
            Refused: the robot refuses the client, does not answer within `PATIENCE_SECONDS`, or is gone.
        """
        with anyio.move_on_after(PATIENCE_SECONDS):
            await self._answered.wait()
        if not self._answered.is_set():
            raise Refused(503, f"the robot {self._robot} does not answer", {"Retry-After": "5"})
        if self._refused is not None:
            raise self._refused

    def _answer(self, refusal: Refusal | None) -> None:
        if refusal is not None:
            try:
                check_headers(refusal.headers)
            except BadOpening as error:
                self._refused = Refused(502, f"the robot's answer cannot be read: {error}")
            else:
                self._refused = Refused(refusal.status, refusal.reason, refusal.headers)
        self._answered.set()

    def receive(self, data: bytes, binary: bool) -> None:
        """No-op: the stream is paused."""

    def closed(self, code: int, reason: str) -> None:
        """Refuse the client of a robot that is gone."""
        if not self._answered.is_set():
            text = f"the robot {self._robot} is gone: {reason}"
            self._refused = Refused(503, text, {"Retry-After": "1"})
            self._answered.set()


def join(client: ClientEnd, robot: RobotEnd) -> None:
    """Pass messages between two ends from now on."""
    client.other, robot.other = robot, client
    robot.stream.hand_over(robot)
    robot.stream.resume()
