"""Messages as programs publish and receive them."""

from __future__ import annotations

import inspect
import logging
import time
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Final, TypeAlias, cast

import msgspec

from rwt_interfaces.errors import InterfaceError, InvalidMessage
from rwt_interfaces.payload import Payload
from rwt_participant.errors import WrongType

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from rwt_interfaces.registry import Registry
    from rwt_interfaces.structs import ActionType, MessageType, ServiceType

logger = logging.getLogger(__name__)

#: Duration in seconds from which on a callback is reported: no other client is served meanwhile.
HELD_SECONDS: Final = 1.0

#: Accepted forms of a message; values are checked and completed according to its type.
MessageLike: TypeAlias = "Payload | msgspec.Struct | Mapping[str, object] | DataclassInstance"

#: Typed message: a Struct compiled from its definition, shared and read-only. Type checkers do not know its
#: fields, which are known at run time.
Message: TypeAlias = Any

#: Takes the typed message. A coroutine function runs in a task of its own, one message at a time.
MessageCallback: TypeAlias = Callable[[Message], object]


class RawMessage(msgspec.Struct, frozen=True, gc=False):
    """One message, serialised.

    Attributes:
        data: CDR with its encapsulation header, or the ROS 1 serialisation if the robot speaks ROS 1.
        stamp_ns: time of publishing, nanoseconds since the epoch; None if the robot's server sends none.
        type: message type.
    """

    data: bytes | memoryview
    stamp_ns: int | None
    type: MessageType


#: Takes the serialised message; a plain function.
RawCallback: TypeAlias = Callable[[RawMessage], object]

#: Value of a parameter: bool, int, float, str, bytes, lists, and on ROS 1 dictionaries and None.
ParameterValue: TypeAlias = Any

#: Takes the request and returns the response, or an awaitable of it; None is a response of defaults.
ServiceHandler: TypeAlias = Callable[[Message], "MessageLike | Awaitable[MessageLike | None] | None"]


def to_payload(interface: MessageType, message: object, now: Callable[[], int] = time.time_ns) -> Payload:
    """Return a payload of that type.

    Args:
        message: instance of the type's class, mapping, dataclass instance, or payload.
        now: time for headers without a stamp, nanoseconds since the epoch.

    Raises:
        InvalidMessage: the message does not fit the type, or is a payload of another one.
    """
    if isinstance(message, Payload):
        if message.type is not interface and message.type.name != interface.name:
            raise InvalidMessage("", f"expected a {interface.name}, got a {message.type.name}")
        return message
    return Payload.from_value(interface, message, now)


def type_of(message: object, registry: Registry) -> str | None:
    """Return the type name of a payload or an instance of a message's class; None for others.

    The class may be of another registry, such as those of :mod:`rwt_interfaces.jazzy`, if it has the fields
    that `registry` knows of that type.
    """
    if isinstance(message, Payload):
        return message.type.name
    if not isinstance(message, msgspec.Struct):
        return None
    name = f"{type(message).__module__}/{type(message).__name__}"
    try:
        known = registry.message(name)
    except InterfaceError:
        return None
    return name if known.struct.__struct_fields__ == message.__struct_fields__ else None


def check_interface(name: str, stated: ServiceType | ActionType, known: ServiceType | ActionType) -> None:
    """Check that a service or action has the stated type, or one with the same fields.

    Raises:
        WrongType: it has another one.
    """
    if stated.name == known.name:
        return
    if any(one.md5 != other.md5 for one, other in zip(stated.parts, known.parts, strict=True)):
        raise WrongType(f"{name} has type {known.name}, not {stated.name}")


def check_arguments(verb: str, type: object = None, function: object = len) -> None:
    """Check the type name and the function that a program gives to a verb.

    Args:
        verb: signature of the verb, for the error.

    Raises:
        TypeError: `type` is neither a string nor None, or `function` cannot be called.
    """
    if not callable(function):
        raise TypeError(f"{verb}: expected a function, got {function!r}")
    if type is not None and not isinstance(type, str):
        raise TypeError(f'{verb}: expected the name of a type, such as "std_msgs/String", got {type!r}')


def warn_of_held_loop(callback: object, what: str, took: float) -> None:
    """Log a warning about a callback, named by `what`, that took at least :data:`HELD_SECONDS`."""
    logger.warning(
        "%s %s took %.1f s and held the event loop: pass `threaded=True` with it, or make it an `async def`"
        " function that awaits what is slow",
        what,
        getattr(callback, "__qualname__", None) or repr(callback),
        took,
    )


def call_handler(
    handler: ServiceHandler,
    request: Message,
    response: MessageType,
    reply: Callable[[Payload], object],
    fail: Callable[[Exception], object],
    spawn: Callable[[Callable[[], Coroutine[object, object, None]]], object],
    now: Callable[[], int] = time.time_ns,
) -> None:
    """Answer one call of a service, at once or from a task.

    Args:
        reply: takes the response; an exception that it raises is passed to `fail`.
        fail: takes the exception of the handler.
        spawn: starts a task, for a handler that must be awaited.
        now: time for headers without a stamp, nanoseconds since the epoch.
    """
    try:
        began = time.perf_counter()
        answer = handler(request)
        if (took := time.perf_counter() - began) >= HELD_SECONDS:
            warn_of_held_loop(handler, "service handler", took)
        # Like `inspect.isawaitable`, in a tenth of the time, and without generators of `types.coroutine`.
        if not hasattr(answer, "__await__"):
            reply(to_payload(response, {} if answer is None else answer, now))
            return
    except Exception as error:
        fail(error)
        return

    async def finish() -> None:
        try:
            value = await cast("Awaitable[MessageLike | None]", answer)
            reply(to_payload(response, {} if value is None else value, now))
        except Exception as error:
            fail(error)

    spawn(finish)


def is_coroutine_function(function: Callable[..., object]) -> bool:
    """Return True if a call makes a coroutine; looks into partials and objects with `__call__`."""
    while isinstance(function, partial):
        function = function.func
    return inspect.iscoroutinefunction(function) or inspect.iscoroutinefunction(
        getattr(function, "__call__", None)  # noqa: B004 - the method itself is inspected; `callable` would not return it
    )
