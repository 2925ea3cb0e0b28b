"""Mission protocol: plans, fences and rally points, uploaded and downloaded exactly.

The receiver of items requests each by its number, so repetitions and duplicates do no harm
(https://mavlink.io/en/services/mission.html).
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from enum import IntEnum
from typing import Final, NamedTuple

import anyio

from rwt_mavlink.link.frames import MavlinkMessage, dialect
from rwt_mavlink.protocol.errors import NoAnswer, Rejected
from rwt_mavlink.protocol.exchange import Exchange, Inbox

ATTEMPTS: Final = 10
"""Consecutive transmissions without an answer before a transfer fails."""

ANSWER_SECONDS: Final = 1.0
MAX_ITEMS: Final = 10_000
"""Maximum items of a plan."""

#: Time in which messages of an earlier transfer may still arrive.
_LATE_SECONDS: Final = 3.0


class Plan(IntEnum):
    """Kinds of plans, with the numbers of MAV_MISSION_TYPE."""

    MISSION = 0
    FENCE = 1
    RALLY = 2


class MissionItem(NamedTuple):
    """Item of a plan, as MISSION_ITEM_INT has it.

    Attributes:
        x: latitude in 1e-7 degrees, or local x in 0.1 mm.
        y: longitude in 1e-7 degrees, or local y in 0.1 mm.
    """

    frame: int
    command: int
    current: int
    autocontinue: int
    param1: float
    param2: float
    param3: float
    param4: float
    x: int
    y: int
    z: float


class MissionProtocol:
    """Mission protocol with one vehicle; one transfer at a time.

    Args:
        exchange: messages of the vehicle.
    """

    def __init__(self, exchange: Exchange) -> None:
        self._exchange = exchange
        self._lock = anyio.Lock()
        self._settled_at = 0.0

    async def download(self, plan: Plan) -> tuple[MissionItem, ...]:
        """Return the items of a plan.

        Raises:
            Unavailable, NoAnswer, Rebooted: the vehicle does not answer.
            Rejected: it does not transfer this plan, or the plan has too many items.
        """
        system, component = self._target
        types = ("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ACK")
        async with self._lock:
            await self._settle()
            with self._listening(plan, *types) as inbox:
                first = dialect.MAVLink_mission_request_list_message(system, component, plan)
                count = (await self._ask(first, inbox, "MISSION_COUNT")).count
                if count > MAX_ITEMS:
                    raise Rejected(f"the vehicle has {count} items, maximum is {MAX_ITEMS}")
                items: list[MissionItem] = []
                for number in range(count):
                    request = dialect.MAVLink_mission_request_int_message(system, component, number, plan)
                    items.append(_item(await self._ask(request, inbox, "MISSION_ITEM_INT", number)))
            accepted = dialect.MAV_MISSION_ACCEPTED
            self._exchange.send(dialect.MAVLink_mission_ack_message(system, component, accepted, plan))
            return tuple(items)

    async def upload(self, items: Sequence[MissionItem], plan: Plan) -> None:
        """Replace a plan of the vehicle. An empty one is cleared.

        Raises:
            Unavailable, NoAnswer, Rebooted: the vehicle does not answer.
            Rejected: it does not accept the plan, or the plan has too many items.
        """
        if not items:
            await self.clear(plan)
            return
        if len(items) > MAX_ITEMS:
            raise Rejected(f"the plan has {len(items)} items, maximum is {MAX_ITEMS}")
        async with self._lock:
            await self._settle()
            with self._listening(plan, "MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK") as inbox:
                await self._send_items(items, plan, inbox)

    async def clear(self, plan: Plan) -> None:
        """Clear a plan of the vehicle; raises what :meth:`upload` raises."""
        async with self._lock:
            await self._settle()
            with self._listening(plan, "MISSION_ACK") as inbox:
                request = dialect.MAVLink_mission_clear_all_message(*self._target, plan)
                await self._ask(request, inbox, "MISSION_ACK")

    @property
    def _target(self) -> tuple[int, int]:
        return self._exchange.target.system, self._exchange.target.component

    def _listening(self, plan: Plan, *types: str) -> AbstractContextManager[Inbox]:
        return self._exchange.listening(*types, where=lambda message: message.mission_type == plan)

    async def _settle(self) -> None:
        """Wait until messages of an earlier transfer with repetitions no longer arrive."""
        left = self._settled_at - self._exchange.clock.monotonic()
        if left > 0:
            await self._exchange.clock.sleep(left)

    def _repeat(self, message: MavlinkMessage) -> None:
        self._settled_at = self._exchange.clock.monotonic() + _LATE_SECONDS
        self._exchange.send(message)

    async def _ask(
        self, request: MavlinkMessage, inbox: Inbox, type: str, number: int | None = None
    ) -> MavlinkMessage:
        """Send a request until its answer arrives."""
        for attempt in range(ATTEMPTS):
            self._exchange.check()
            if attempt:
                self._repeat(request)
            else:
                self._exchange.send(request)
            while (message := await inbox.get(ANSWER_SECONDS)) is not None:
                if message.get_type() == "MISSION_ACK":
                    _raise_unless_accepted(message)
                if message.get_type() == type and number in (None, getattr(message, "seq", None)):
                    return message
        raise NoAnswer(f"no answer from the vehicle to {request.get_type()} (sent {ATTEMPTS} times)")

    async def _send_items(self, items: Sequence[MissionItem], plan: Plan, inbox: Inbox) -> None:
        system, component = self._target
        latest: MavlinkMessage = dialect.MAVLink_mission_count_message(system, component, len(items), plan)
        requested: set[int] = set()
        self._exchange.check()
        self._exchange.send(latest)
        silent = 0
        while silent < ATTEMPTS:
            message = await inbox.get(ANSWER_SECONDS)
            if message is None:
                silent += 1
                self._exchange.check()
                self._repeat(latest)
            elif message.get_type() == "MISSION_ACK":
                _raise_unless_accepted(message)
                if len(requested) == len(items):  # Otherwise, it answers an earlier transfer.
                    return
            elif message.seq < len(items):
                if message.seq not in requested:
                    silent = 0
                elif (silent := silent + 1) >= ATTEMPTS:
                    break
                requested.add(message.seq)
                latest = dialect.MAVLink_mission_item_int_message(
                    system, component, message.seq, *items[message.seq], plan
                )
                self._exchange.send(latest)
        raise NoAnswer(
            f"the vehicle requested {len(requested)} of {len(items)} items, and did not confirm the plan"
        )


def _item(message: MavlinkMessage) -> MissionItem:
    return MissionItem(*(getattr(message, name) for name in MissionItem._fields))


def _raise_unless_accepted(ack: MavlinkMessage) -> None:
    if ack.type != dialect.MAV_MISSION_ACCEPTED:
        found = dialect.enums["MAV_MISSION_RESULT"].get(ack.type)
        name = found.name if found is not None else f"result {ack.type}"
        raise Rejected(f"the vehicle answered {name}")
