"""Messages of services as serialised bytes, in place of C structs, through the callbacks of Fast CDR.

The middleware has no serialised form of requests and responses: it calls a function of their type support
with a `Cdr` and the address of a message. Here that address is only a key: no memory is behind it that a
callback reads, and :class:`CdrExchange` finds the bytes by it.

A `Cdr` has no function that returns the end of what it reads. :func:`check` finds the word that points there,
by messages of known lengths, and reports everything that differs from what is expected.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any, Final

from rwt.extensions.ros2.rcl import SerialisedMessage, check, rmw
from rwt.extensions.ros2.type_supports import c_structures as c
from rwt_graph.errors import Ros2Error

#: Functions of `Cdr`: start of its buffer, present position, and skip.
SYMBOLS: Final = (
    "_ZN8eprosima7fastcdr3Cdr18get_buffer_pointerEv",
    "_ZN8eprosima7fastcdr3Cdr20get_current_positionEv",
    "_ZN8eprosima7fastcdr3Cdr4jumpEm",
)

#: Bytes of the header of a serialised message, which the middleware writes and reads itself.
_HEADER_BYTES: Final = 4

#: Header of a message that is serialised as in all releases of ROS 2, on a little-endian machine.
_HEADER: Final = b"\0\1\0\0"

#: Maximum size of a request or response, which the middleware counts in 32 bits.
LARGEST_BYTES: Final = 2**31 - 1

#: Size of the memory behind the address of a message. Nothing reads it.
MESSAGE_BYTES: Final = 64

#: Words of a `Cdr` in which the end of its buffer is looked for. It is a local variable of the caller, so
#: that the memory behind it, of the caller's callers, is readable as well.
CDR_WORDS: Final = 48
_WORD_BYTES: Final = ctypes.sizeof(ctypes.c_void_p)

#: Lengths of the messages of the check, other than the header's.
_CHECKED: Final = (8, 64, 1000, 13)


class Unsupported(Exception):
    """The middleware does not serialise as expected; the text says what differs."""


@cache
def cdr_functions() -> tuple[Any, Any, Any]:
    """Return the functions of :data:`SYMBOLS`.

    Raises:
        Unsupported: the middleware has other functions, or none.
    """
    loaded = rmw()  # Its symbols include those of the libraries that it needs.
    try:
        start, position, skip = (loaded[symbol] for symbol in SYMBOLS)
    except AttributeError as error:
        raise Unsupported(f"it does not serialise with Fast CDR 2: {error}") from None
    for function, result in ((start, ctypes.c_void_p), (position, ctypes.c_void_p), (skip, ctypes.c_bool)):
        function.restype = result
        function.argtypes = (ctypes.c_void_p,)
    skip.argtypes = (ctypes.c_void_p, ctypes.c_size_t)
    return start, position, skip


class CdrExchange:
    """Callbacks of all messages, and the bytes of those that are being sent or taken.

    A callback never raises: it returns False, by which the middleware fails, and :meth:`reraise` raises the
    exception where Python has called the middleware.

    Attributes:
        serialise, deserialise, size, maximum_size: callbacks; they live as long as the object, which has to
            outlive every type support that names them.
    """

    def __init__(self) -> None:
        self._start, self._position, self._skip = cdr_functions()
        # Bytes of a `Cdr` before the word that points to the end of its buffer; found by the check.
        self._end: int | None = None
        self._seen: list[tuple[int, bytes]] = []
        self._messages: dict[int, bytes] = {}
        self._raised: BaseException | None = None
        self.serialise = c.Serialise(self._serialise)
        self.deserialise = c.Serialise(self._deserialise)
        self.size = c.SizeOf(self._size)
        self.maximum_size = c.MaximumSize(self._maximum_size)

    # Callbacks. Each catches everything: an exception that passed C would be lost, and the result undefined.

    def _serialise(self, message: int, cdr: int) -> bool:
        try:
            data = self._messages[message]
            size = len(data) - _HEADER_BYTES
            start = self._start(cdr)
            if self._position(cdr) != start + _HEADER_BYTES or not self._skip(cdr, size):
                raise Ros2Error(f"the middleware has no room for a message of {size} bytes")
            # With the header, which is the same: no copy without it is made.
            ctypes.memmove(start, data, len(data))
        except BaseException as error:
            self._raised = error
            return False
        return True

    def _deserialise(self, cdr: int, message: int) -> bool:
        try:
            start = self._start(cdr)
            if self._position(cdr) != start + _HEADER_BYTES:
                raise Ros2Error("a message does not begin with its header")
            if self._end is None:
                self._seen.append((start, ctypes.string_at(cdr, CDR_WORDS * _WORD_BYTES)))
                return True
            size = ctypes.c_size_t.from_address(cdr + self._end).value - start
            if not _HEADER_BYTES <= size <= LARGEST_BYTES:
                raise Ros2Error(f"a message is said to have {size} bytes")
            self._messages[message] = ctypes.string_at(start, size)
        except BaseException as error:
            self._raised = error
            return False
        return True

    def _size(self, message: int) -> int:
        try:
            return len(self._messages[message]) - _HEADER_BYTES
        except BaseException as error:
            self._raised = error
            return 0

    def _maximum_size(self, bounds: Any) -> int:
        try:
            bounds[0] = b"\0"  # Unbounded.
        except BaseException as error:
            self._raised = error
        return 0

    # Use

    def put(self, address: int, data: bytes) -> None:
        """Set the bytes of a message that is sent next."""
        self._messages[address] = data

    def pop(self, address: int) -> bytes | None:
        """Return the bytes of a message and forget them; None if it has none."""
        return self._messages.pop(address, None)

    def reraise(self) -> None:
        """Raise what a callback has caught since the last call."""
        raised, self._raised = self._raised, None
        if raised is not None:
            raise raised

    # Check

    def check(self, support: int, address: int) -> None:
        """Find the end of a `Cdr`'s buffer, and exchange messages of several lengths with the middleware.

        Args:
            support: address of a type support with these callbacks.
            address: address of a message.

        Raises:
            Unsupported: the middleware does something else than expected.
        """
        texts = [_HEADER + bytes(range(1, 1 + min(size, 250))).ljust(size, b"\x5a") for size in _CHECKED]
        for data in texts:
            self._read_back(support, address, data)
        found = [
            {
                at
                for at in range(0, len(seen), _WORD_BYTES)
                if int.from_bytes(seen[at : at + _WORD_BYTES], "little") == start + len(data)
            }
            for (start, seen), data in zip(self._seen, texts, strict=False)
        ]
        ends = set.intersection(*found) if len(found) == len(texts) else set()
        if not ends:
            raise Unsupported("Fast CDR has another layout than that of versions 2.2 and 2.3")
        self._end = min(ends)
        self._seen.clear()
        for data in texts:
            self._read_back(support, address, data)
            if self.pop(address) != data:
                raise Unsupported("a message is read otherwise than it was written")

    def _read_back(self, support: int, address: int, data: bytes) -> None:
        """Let the middleware write a message, and read it again."""
        self.put(address, data)
        with SerialisedMessage() as written:
            try:
                check(rmw().rmw_serialize(address, support, ctypes.byref(written)), "cannot be serialised")
                if written.contents() != data:
                    raise Unsupported("a message is serialised otherwise than it was given")
                self.pop(address)
                check(rmw().rmw_deserialize(ctypes.byref(written), support, address), "cannot be read")
            except Ros2Error as error:
                raise Unsupported(f"a message {error}") from error
            finally:
                self.reraise()


class SerialisedForm:
    """Requests or responses of one type, in the form in which an endpoint gives them to rcl.

    Args:
        name: full name of the message, for errors.
    """

    def __init__(self, exchange: CdrExchange, name: str) -> None:
        self._exchange = exchange
        self._name = name
        self._memory = ctypes.create_string_buffer(MESSAGE_BYTES)
        self._address = ctypes.addressof(self._memory)

    def fill(self, data: bytes) -> int:
        """Return the address of a message with these contents, valid until :meth:`clear`.

        Raises:
            Ros2Error: it is larger than a middleware sends.
        """
        if len(data) > LARGEST_BYTES:
            raise Ros2Error(
                f"a message of type {self._name} has {len(data)} bytes, and {LARGEST_BYTES} is the limit"
            )
        self._exchange.put(self._address, data)
        return self._address

    def empty(self) -> int:
        """Return the address of an empty message, valid until :meth:`clear`."""
        return self._address

    def contents(self) -> bytes:
        """Return the contents of the message. Raises Ros2Error if it was not read."""
        data = self._exchange.pop(self._address)
        if data is None:
            raise Ros2Error(f"a message of type {self._name} could not be read")
        return data

    def clear(self) -> None:
        """Forget the contents, and raise what the callbacks have caught."""
        self._exchange.pop(self._address)
        self._exchange.reraise()
