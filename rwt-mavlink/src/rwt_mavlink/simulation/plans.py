"""Mission and parameter services of the simulated vehicle."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, TypeAlias

from rwt_mavlink.link.frames import MavlinkMessage, dialect, text_of
from rwt_mavlink.protocol.exchange import Identity
from rwt_mavlink.protocol.missions import MissionItem, Plan

Send: TypeAlias = Callable[[MavlinkMessage], None]

_REQUEST_SECONDS: Final = 1.0
_REQUESTS: Final = 8
#: Time in which a repeated last item is confirmed once more.
_CONFIRM_SECONDS: Final = 10.0


def sender_of(message: MavlinkMessage) -> Identity:
    """Return the identity of a message's sender."""
    return Identity(message.get_srcSystem(), message.get_srcComponent())


@dataclass
class Transfer:
    """Upload of a plan by one station."""

    station: Identity
    plan: int
    count: int
    items: list[MissionItem] = field(default_factory=list)
    requests: int = 0
    requested_at: float = 0.0


class PlanService:
    """Mission service: requests each item of an upload until it arrives.

    Args:
        send: sends a message to all stations.

    Attributes:
        plans: items by kind of plan.
        uploads: number of plans that were replaced.
    """

    def __init__(self, send: Send) -> None:
        self._send = send
        self._now = 0.0
        self._transfer: Transfer | None = None
        self._done: tuple[Transfer, float] | None = None
        self.plans: dict[int, list[MissionItem]] = {plan: [] for plan in Plan}
        self.uploads = 0

    def restart(self) -> None:
        """Forget the transfers, and keep the plans."""
        self._transfer = self._done = None

    def step(self, now: float) -> None:
        """Repeat a request that was not answered."""
        self._now = now
        transfer = self._transfer
        if transfer is None or now - transfer.requested_at < _REQUEST_SECONDS:
            return
        if transfer.requests >= _REQUESTS:
            self._transfer = None
            self._ack(transfer.station, transfer.plan, dialect.MAV_MISSION_OPERATION_CANCELLED)
        else:
            self._request(transfer)

    def receive(self, message: MavlinkMessage) -> None:
        """Take a message of the mission service."""
        station, plan = sender_of(message), message.mission_type
        match message.get_type():
            case "MISSION_COUNT":
                self._begin(station, message)
            case "MISSION_ITEM_INT":
                self._add(station, message)
            case "MISSION_REQUEST_LIST":
                count = len(self.plans[plan])
                self._send(
                    dialect.MAVLink_mission_count_message(station.system, station.component, count, plan)
                )
            case "MISSION_REQUEST_INT":
                self._answer(station, message)
            case "MISSION_CLEAR_ALL":
                self.plans[plan] = []
                self._ack(station, plan, dialect.MAV_MISSION_ACCEPTED)

    def _begin(self, station: Identity, message: MavlinkMessage) -> None:
        active = self._transfer
        if active is not None and active.station != station:
            self._ack(station, message.mission_type, dialect.MAV_MISSION_DENIED)
            return
        self._transfer = Transfer(station, message.mission_type, message.count)
        self._request(self._transfer)

    def _add(self, station: Identity, message: MavlinkMessage) -> None:
        transfer = self._transfer
        if transfer is None or transfer.station != station:
            if self._done is not None and self._done[0].station == station:
                done, at = self._done
                if self._now - at < _CONFIRM_SECONDS and message.seq == done.count - 1:
                    self._ack(station, done.plan, dialect.MAV_MISSION_ACCEPTED)
            return
        if message.seq == len(transfer.items):
            transfer.items.append(MissionItem(*(getattr(message, name) for name in MissionItem._fields)))
            transfer.requests = 0
        if len(transfer.items) < transfer.count:
            self._request(transfer)
            return
        self.plans[transfer.plan] = transfer.items
        self.uploads += 1
        self._transfer, self._done = None, (transfer, self._now)
        self._ack(station, transfer.plan, dialect.MAV_MISSION_ACCEPTED)

    def _answer(self, station: Identity, message: MavlinkMessage) -> None:
        items = self.plans[message.mission_type]
        if message.seq >= len(items):
            self._ack(station, message.mission_type, dialect.MAV_MISSION_INVALID_SEQUENCE)
            return
        item, target = items[message.seq], (station.system, station.component)
        self._send(
            dialect.MAVLink_mission_item_int_message(*target, message.seq, *item, message.mission_type)
        )

    def _request(self, transfer: Transfer) -> None:
        transfer.requests += 1
        transfer.requested_at = self._now
        station = transfer.station
        self._send(
            dialect.MAVLink_mission_request_int_message(
                station.system, station.component, len(transfer.items), transfer.plan
            )
        )

    def _ack(self, station: Identity, plan: int, result: int) -> None:
        self._send(dialect.MAVLink_mission_ack_message(station.system, station.component, result, plan))


class ParameterService:
    """Parameter service; integers are floats, or have their own bits as those of PX4.

    Args:
        send: sends a message to all stations.
        is_bytewise: True for integers with their own bits.

    Attributes:
        values: integers of 32 bits and floats, by name.
        writes: all values that were set, in order.
    """

    def __init__(self, send: Send, is_bytewise: bool) -> None:
        self._send = send
        self._is_bytewise = is_bytewise
        self.values: dict[str, int | float] = {}
        self.writes: list[tuple[str, int | float]] = []
        self._queue: list[int] = []

    def step(self) -> None:
        """Send a few parameters of a requested list."""
        for index in self._queue[:20]:
            self._report(index)
        del self._queue[:20]

    def receive(self, message: MavlinkMessage) -> None:
        """Take a message of the parameter service."""
        match message.get_type():
            case "PARAM_REQUEST_LIST":
                self._queue = list(range(len(self.values)))
            case "PARAM_REQUEST_READ":
                names = list(self.values)
                name = text_of(message.param_id)
                if message.param_index >= 0:
                    if message.param_index < len(names):
                        self._report(message.param_index)
                elif name in self.values:
                    self._report(names.index(name))
            case "PARAM_SET":
                self._set(message)

    def _set(self, message: MavlinkMessage) -> None:
        name = text_of(message.param_id)
        if name not in self.values:
            return
        value: int | float = message.param_value
        if isinstance(self.values[name], int):
            value = self._integer(value)
        if value != self.values[name]:
            self.writes.append((name, value))
        self.values[name] = value
        self._report(list(self.values).index(name))

    def _integer(self, value: float) -> int:
        if self._is_bytewise:
            return int(struct.unpack("<i", struct.pack("<f", value))[0])
        return round(value)

    def _report(self, index: int) -> None:
        name, value = list(self.values.items())[index]
        is_integer = isinstance(value, int)
        sent = float(value)
        if is_integer and self._is_bytewise:
            sent = struct.unpack("<f", struct.pack("<i", value))[0]
        type = dialect.MAV_PARAM_TYPE_INT32 if is_integer else dialect.MAV_PARAM_TYPE_REAL32
        self._send(dialect.MAVLink_param_value_message(name.encode(), sent, type, len(self.values), index))
