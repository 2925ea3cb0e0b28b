"""Parameter protocol: reading all, reading one, and setting one until the vehicle confirms the value.

https://mavlink.io/en/services/parameter.html
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Final

import anyio

from rwt_mavlink.link.frames import MavlinkMessage, dialect, text_of
from rwt_mavlink.protocol.errors import NoAnswer, Rejected
from rwt_mavlink.protocol.exchange import Exchange, Inbox

ATTEMPTS: Final = 10
"""Transmissions of a request before it fails."""

ANSWER_SECONDS: Final = 1.0
MAX_PARAMETERS: Final = 10_000
"""Maximum parameters of a vehicle."""

#: Parameters that are requested at once by number, to fill gaps.
_BATCH: Final = 16
_NAME_BYTES: Final = 16
#: Answers with another value after which it counts as rejected: earlier ones may have been on their way.
_OTHER_VALUES: Final = 3
#: Integers beyond which a 32-bit float is not exact.
_EXACT: Final = 2**24

#: Formats of `struct` and ranges, by MAV_PARAM_TYPE.
_INTEGERS: Final = {
    dialect.MAV_PARAM_TYPE_UINT8: ("<Bxxx", 0, 2**8 - 1),
    dialect.MAV_PARAM_TYPE_INT8: ("<bxxx", -(2**7), 2**7 - 1),
    dialect.MAV_PARAM_TYPE_UINT16: ("<Hxx", 0, 2**16 - 1),
    dialect.MAV_PARAM_TYPE_INT16: ("<hxx", -(2**15), 2**15 - 1),
    dialect.MAV_PARAM_TYPE_UINT32: ("<I", 0, 2**32 - 1),
    dialect.MAV_PARAM_TYPE_INT32: ("<i", -(2**31), 2**31 - 1),
}


@dataclass(frozen=True, slots=True)
class Parameter:
    """Parameter of a vehicle.

    Attributes:
        value: integer or float, by its type.
        type: number of MAV_PARAM_TYPE.
        index: number among the parameters; 65535 if the vehicle did not state it.
        count: number of parameters of the vehicle.
    """

    name: str
    value: int | float
    type: int
    index: int
    count: int


class ParameterProtocol:
    """Parameter protocol with one vehicle.

    Args:
        exchange: messages of the vehicle.
        is_bytewise: returns True if integers have their own bits in the field, as those of PX4, and False if
            they are converted to floats, as those of ArduPilot.

    Attributes:
        known: parameters by name, as last received.
    """

    def __init__(self, exchange: Exchange, is_bytewise: Callable[[], bool]) -> None:
        self._exchange = exchange
        self._is_bytewise = is_bytewise
        self._lock = anyio.Lock()
        self.known: dict[str, Parameter] = {}

    def receive(self, message: MavlinkMessage) -> Parameter:
        """Store a PARAM_VALUE of any request, also of another station's, and return the parameter."""
        parameter = self._decoded(message)
        if parameter.name in self.known or len(self.known) < MAX_PARAMETERS:
            self.known[parameter.name] = parameter
        return parameter

    async def pull(self) -> tuple[Parameter, ...]:
        """Read all parameters, by their numbers.

        Raises:
            Unavailable, NoAnswer, Rebooted: the vehicle does not answer.
            Rejected: it has too many parameters.
        """
        async with self._lock:
            with self._exchange.listening("PARAM_VALUE") as inbox:
                found = await self._list(inbox)
                silent = 0
                while missing := _missing(found):
                    if silent == ATTEMPTS:
                        raise NoAnswer(f"{len(missing)} of {_count(found)} parameters were not received")
                    for index in missing[:_BATCH]:
                        self._request(b"", index)
                    before = len(found)
                    await self._collect(inbox, found, missing[:_BATCH])
                    silent = 0 if len(found) > before else silent + 1
        return tuple(found[index] for index in sorted(found))

    async def get(self, name: str) -> Parameter:
        """Read one parameter.

        Raises:
            Unavailable, NoAnswer, Rebooted: the vehicle does not answer, or has no such parameter.
            Rejected: the name is too long.
        """
        encoded = _encoded_name(name)
        with self._listening_for(name) as inbox:
            for _ in range(ATTEMPTS):
                self._request(encoded, -1)
                message = await inbox.get(ANSWER_SECONDS)
                if message is not None:
                    return self._decoded(message)
        raise NoAnswer(f"no answer from the vehicle about the parameter {name}, which it may not have")

    async def set(self, name: str, value: float) -> Parameter:
        """Set one parameter, and return it as the vehicle confirms it.

        Raises:
            Unavailable, NoAnswer, Rebooted: the vehicle does not answer.
            Rejected: the value does not fit the type, or the vehicle keeps another value.
        """
        known = self.known.get(name) or await self.get(name)
        encoded, field = _encoded_name(name), self._encoded(known, value)
        wanted = value if known.type in _INTEGERS else _single(value)
        target = self._exchange.target
        request = dialect.MAVLink_param_set_message(
            target.system, target.component, encoded, field, known.type
        )
        others = 0
        async with self._lock:
            with self._listening_for(name) as inbox:
                for _ in range(ATTEMPTS):
                    self._exchange.check()
                    self._exchange.send(request)
                    while (message := await inbox.get(ANSWER_SECONDS)) is not None:
                        parameter = self._decoded(message)
                        if parameter.value == wanted:
                            return parameter
                        others += 1
                        if others == _OTHER_VALUES:
                            raise Rejected(f"the vehicle keeps {name} = {parameter.value:g}, not {value:g}")
                        break
        raise NoAnswer(f"no answer from the vehicle to {name} = {value:g}; its value is not known")

    def _listening_for(self, name: str) -> AbstractContextManager[Inbox]:
        return self._exchange.listening(
            "PARAM_VALUE", where=lambda message: text_of(message.param_id) == name
        )

    def _request(self, name: bytes, index: int) -> None:
        target = self._exchange.target
        self._exchange.check()
        self._exchange.send(
            dialect.MAVLink_param_request_read_message(target.system, target.component, name, index)
        )

    async def _list(self, inbox: Inbox) -> dict[int, Parameter]:
        found: dict[int, Parameter] = {}
        target = self._exchange.target
        for _ in range(ATTEMPTS):
            self._exchange.check()
            self._exchange.send(dialect.MAVLink_param_request_list_message(target.system, target.component))
            await self._collect(inbox, found, None)
            if found:
                return found
        raise NoAnswer("no answer from the vehicle to PARAM_REQUEST_LIST")

    async def _collect(self, inbox: Inbox, found: dict[int, Parameter], wanted: list[int] | None) -> None:
        """Add parameters until none arrives for a while, or the wanted ones are there."""
        while wanted is None or not found.keys() >= set(wanted):
            message = await inbox.get(ANSWER_SECONDS)
            if message is None:
                return
            parameter = self._decoded(message)
            if parameter.count > MAX_PARAMETERS:
                raise Rejected(f"the vehicle has {parameter.count} parameters, maximum is {MAX_PARAMETERS}")
            if parameter.index >= parameter.count:
                continue  # The answer to a request by name.
            if found and parameter.count != _count(found):
                found.clear()  # Parameters appeared or disappeared, and have new numbers.
            found[parameter.index] = parameter
            if wanted is None and len(found) == parameter.count:
                return

    def _decoded(self, message: MavlinkMessage) -> Parameter:
        value: int | float = message.param_value
        if message.param_type in _INTEGERS:
            form = _INTEGERS[message.param_type][0]
            if self._is_bytewise():
                value = struct.unpack(form, struct.pack("<f", value))[0]
            elif math.isfinite(value):
                value = round(value)
        return Parameter(
            text_of(message.param_id), value, message.param_type, message.param_index, message.param_count
        )

    def _encoded(self, known: Parameter, value: float) -> float:
        if known.type not in _INTEGERS:
            return _single(value)
        form, low, high = _INTEGERS[known.type]
        if not math.isfinite(value) or value != int(value) or not low <= value <= high:
            raise Rejected(f"{known.name} is an integer from {low} to {high}, got {value:g}")
        if self._is_bytewise():
            packed = struct.pack(form, int(value))
            field = float(struct.unpack("<f", packed)[0])
            if struct.pack("<f", field) != packed:  # The bits of a signalling NaN do not survive.
                raise Rejected(f"{known.name} = {value:g} cannot be transferred exactly")
            return field
        if abs(value) > _EXACT:
            raise Rejected(f"{known.name} = {value:g} cannot be transferred exactly to this autopilot")
        return float(value)


def _count(found: dict[int, Parameter]) -> int:
    return next(iter(found.values())).count


def _missing(found: dict[int, Parameter]) -> list[int]:
    return [index for index in range(_count(found)) if index not in found]


def _single(value: float) -> float:
    """Return the nearest 32-bit float."""
    try:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        raise Rejected(f"{value:g} is no 32-bit float") from None


def _encoded_name(name: str) -> bytes:
    encoded = name.encode("utf-8")
    if not 0 < len(encoded) <= _NAME_BYTES:
        raise Rejected(f"{name!r} is no name of a parameter: expected 1 to {_NAME_BYTES} bytes")
    return encoded
