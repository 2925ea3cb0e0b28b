"""Command protocol: a command, its acknowledgement, and repetitions that are never new commands.

A repetition has a higher number in the field `confirmation`, by which a vehicle recognises it
(https://mavlink.io/en/services/command.html). Autopilots that ignore this field execute a repeated command
once more, so only commands that are harmless when executed twice are repeated; COMMAND_INT has no such field
and is sent once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import anyio

from rwt_mavlink.link.frames import MavlinkMessage, dialect
from rwt_mavlink.protocol.errors import NoAnswer
from rwt_mavlink.protocol.exchange import Exchange, Inbox

ATTEMPTS: Final = 6
"""Transmissions of a command before the call fails."""

ANSWER_SECONDS: Final = 1.0
"""Time to answer a transmission."""

_PROGRESS_SECONDS: Final = 30.0
#: Time for a sign that the vehicle has not restarted, before a repetition.
_RUNNING_SECONDS: Final = 5.0
#: Time in which an acknowledgement of an earlier command may still arrive.
_LATE_SECONDS: Final = 3.0
_MAX_CONFIRMATION: Final = 255

REPEATABLE: Final = frozenset(
    {
        dialect.MAV_CMD_COMPONENT_ARM_DISARM,
        dialect.MAV_CMD_DO_SET_MODE,
        dialect.MAV_CMD_NAV_TAKEOFF,
        dialect.MAV_CMD_NAV_LAND,
        dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH,
        dialect.MAV_CMD_DO_SET_HOME,
        dialect.MAV_CMD_DO_REPOSITION,
        dialect.MAV_CMD_DO_PAUSE_CONTINUE,
        dialect.MAV_CMD_DO_FENCE_ENABLE,
        dialect.MAV_CMD_DO_SET_MISSION_CURRENT,
        dialect.MAV_CMD_MISSION_START,
        dialect.MAV_CMD_SET_MESSAGE_INTERVAL,
        dialect.MAV_CMD_REQUEST_MESSAGE,
    }
)
"""Commands whose repetition has no effect on a vehicle that executed them."""


@dataclass(frozen=True, slots=True)
class Answer:
    """Acknowledgement of a command.

    Attributes:
        result: number of MAV_RESULT.
    """

    result: int

    @property
    def is_accepted(self) -> bool:
        """True if the vehicle executes or has executed the command."""
        return self.result == int(dialect.MAV_RESULT_ACCEPTED)

    @property
    def text(self) -> str:
        """Name of the result, such as MAV_RESULT_DENIED."""
        found = dialect.enums["MAV_RESULT"].get(self.result)
        return found.name if found is not None else f"result {self.result}"


class _Record:
    """Transmissions of one kind of command.

    Attributes:
        lock: held while a command of that kind is executed.
        unanswered: transmissions of earlier commands whose acknowledgements may still arrive.
        settled_at: time after which they no longer arrive.
    """

    def __init__(self) -> None:
        self.lock = anyio.Lock()
        self.unanswered = 0
        self.settled_at = 0.0


class CommandProtocol:
    """Command protocol with one vehicle. Commands of different kinds run concurrently.

    Args:
        exchange: messages of the vehicle.
    """

    def __init__(self, exchange: Exchange) -> None:
        self._exchange = exchange
        self._records: dict[int, _Record] = {}

    async def execute(self, command: int, parameters: Sequence[float], confirmation: int = 0) -> Answer:
        """Send a COMMAND_LONG and return its acknowledgement.

        Args:
            command: number of MAV_CMD.
            parameters: up to seven parameters; the others are 0.
            confirmation: number of the first transmission.

        Raises:
            Unavailable: the vehicle cannot be commanded now.
            NoAnswer: there was no acknowledgement.
            Rebooted: the vehicle restarted first.
        """
        seven = [*parameters, *[0.0] * (7 - len(parameters))]
        target = self._exchange.target
        attempts = ATTEMPTS if command in REPEATABLE else 1
        messages = [
            dialect.MAVLink_command_long_message(
                target.system,
                target.component,
                command,
                min(confirmation + attempt, _MAX_CONFIRMATION),
                *seven,
            )
            for attempt in range(attempts)
        ]
        return await self._run(command, messages)

    async def execute_int(self, message: MavlinkMessage) -> Answer:
        """Send a COMMAND_INT once and return its acknowledgement; raises what :meth:`execute` raises."""
        return await self._run(message.command, [message])

    async def _run(self, command: int, messages: Sequence[MavlinkMessage]) -> Answer:
        record = self._records.setdefault(command, _Record())
        async with record.lock:
            self._exchange.check()
            with self._exchange.listening("COMMAND_ACK", where=lambda ack: ack.command == command) as inbox:
                return await self._transmit(command, messages, record, inbox)

    async def _transmit(
        self, command: int, messages: Sequence[MavlinkMessage], record: _Record, inbox: Inbox
    ) -> Answer:
        clock, sent, received = self._exchange.clock, 0, 0
        wait = ANSWER_SECONDS * ATTEMPTS / len(messages)
        try:
            for message in messages:
                self._exchange.check()
                # A vehicle that restarted has forgotten the command: a repetition would be a new one.
                if sent and not await self._exchange.is_running(_RUNNING_SECONDS):
                    break
                self._exchange.send(message)
                sent += 1
                ack = await self._answer(record, inbox, wait)
                if ack is None:
                    continue
                received += 1
                while ack is not None and ack.result == dialect.MAV_RESULT_IN_PROGRESS:
                    ack = await inbox.get(_PROGRESS_SECONDS)
                if ack is None:
                    raise NoAnswer(f"{_name(command)}: the vehicle began, and reported no result")
                return Answer(ack.result)
        finally:
            # Each transmission may be acknowledged; a late one must not answer the next command.
            record.unanswered = max(0, sent - received)
            record.settled_at = clock.monotonic() + _LATE_SECONDS
        times = f"{sent} times" if sent > 1 else "once"
        raise NoAnswer(
            f"{_name(command)}: no answer from the vehicle (sent {times});"
            " whether it executed the command is not known"
        )

    async def _answer(self, record: _Record, inbox: Inbox, seconds: float) -> MavlinkMessage | None:
        """Return the next acknowledgement that cannot be one of an earlier command."""
        clock = self._exchange.clock
        deadline = clock.monotonic() + seconds
        while (left := deadline - clock.monotonic()) > 0:
            ack = await inbox.get(left)
            if ack is None or record.unanswered == 0 or clock.monotonic() >= record.settled_at:
                return ack
            record.unanswered -= 1
        return None


def _name(command: int) -> str:
    found = dialect.enums["MAV_CMD"].get(command)
    return found.name if found is not None else f"command {command}"
