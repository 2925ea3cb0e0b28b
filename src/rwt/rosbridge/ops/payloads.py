"""Check the raw payload of an op against its type; an error names the field that does not fit."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Final, TypeGuard

import msgspec

from rwt_interfaces.errors import InvalidMessage, NotExact, TooManyValues
from rwt_interfaces.payload import LARGE_BYTES, Payload
from rwt_interfaces.serialise.json import MAX_LENIENT_VALUES, has_many_values
from rwt_interfaces.steps import finished
from rwt_interfaces.structs import MessageType
from rwt_protocol.dispatcher import Steps
from rwt_protocol.error_text import describe_kind
from rwt_protocol.errors import Refused
from rwt_protocol.payloads import EMPTY, FEW_BYTES, Decoded, Encodable, RawJson

IN_STEPS: Final = LARGE_BYTES
"""Minimum size of a payload that is checked in steps, in bytes."""


def payload_of(type: MessageType, raw: Encodable, where: str, now: Callable[[], int]) -> Payload:
    """Check `raw` against `type`.

    Args:
        where: op and field, for example ``publish.msg``; the refusal's path starts with it.
        now: ROS time in nanoseconds, for header stamps (PUB-05) and the string "now" (JSN-28).

    Raises:
        Refused: it does not fit; for example ``publish.msg.linear.x: expected float64, got "fast"``.
    """
    try:
        if isinstance(raw, Decoded):
            return _of_object(type, raw, where, now)
        if not isinstance(raw, RawJson):
            return Payload.from_json(type, raw.json(), now)
        if raw.dense:
            return finished(Payload.from_json_in_steps(type, raw.data, now, is_dense=True))
        return Payload.from_json(type, raw.data, now)
    except InvalidMessage as error:
        validated = _validated(type, raw, where, error)
    return payload_of(type, validated, where, now)


def payload_in_steps(
    type: MessageType, raw: RawJson | Decoded, where: str, now: Callable[[], int]
) -> Generator[None, None, Payload]:
    """Check a payload like :func:`payload_of`, in steps of about a millisecond."""
    try:
        if isinstance(raw, Decoded):
            yield
            if isinstance(raw.value, dict):
                return (yield from Payload.from_value_in_steps(type, raw.value, now))
            return _of_object(type, raw, where, now)
        return (yield from Payload.from_json_in_steps(type, raw.data, now, is_dense=bool(raw.dense)))
    except InvalidMessage as error:
        validated = _validated(type, raw, where, error)
    return (yield from payload_in_steps(type, validated, where, now))


def checked_values(
    type: MessageType, values: Encodable, where: str, now: Callable[[], int]
) -> Generator[None, None, Payload]:
    """Check a provider's values, in steps if they are large."""
    if is_large(values):
        return (yield from payload_in_steps(type, values, where, now))
    return payload_of(type, values, where, now)


def is_large(values: Encodable) -> TypeGuard[RawJson]:
    """Return True for a payload that is checked in steps."""
    return isinstance(values, RawJson) and values.size >= IN_STEPS


def now_or_in_steps(values: Encodable, steps: Steps) -> Steps | None:
    """Take the steps that check `values` now, or return them if they are for later turns."""
    if is_large(values):
        return steps
    for _ in steps:
        pass
    return None


def _of_object(type: MessageType, raw: Decoded, where: str, now: Callable[[], int]) -> Payload:
    if raw.kind != "object":
        raise Refused(f"{where}: expected an object, got {describe_kind(raw)}")
    return Payload.from_value(type, raw.value, now)


def _validated(type: MessageType, raw: Encodable, where: str, error: InvalidMessage) -> RawJson:
    """Return the validated form of a payload that does not fit, if it differs. Otherwise raises Refused.

    A large payload was cut out of its frame unparsed; only a full parse finds the fault.
    """
    if isinstance(error, NotExact):
        reason = raw.dense if isinstance(raw, RawJson) else ""
        raise Refused(
            f"{where}: {reason}: so many are taken only in a message that has every field of {type.name},"
            " each as ROS writes it"
        ) from None
    if isinstance(raw, RawJson) and not (raw.is_validated or isinstance(error, TooManyValues)):
        validated = raw.validated()
        if validated.data != bytes(raw.data):
            return validated
    raise refusal(where, error) from None


def arguments_of(
    type: MessageType, raw: Encodable, where: str, now: Callable[[], int], checked: Payload | None = None
) -> Payload:
    """Check arguments: an object by name, a list by position, or none (SRV-02). Raises Refused.

    Args:
        checked: the arguments as checked before, against a type that may be another one by now.
    """
    if checked is not None and checked.type is type:
        return checked
    if isinstance(raw, RawJson) and raw.data[0] == ord("{"):
        return payload_of(type, raw, where, now)
    if not isinstance(raw, RawJson | Decoded) or raw.kind == "object":
        return payload_of(type, raw, where, now)
    try:
        if isinstance(raw, Decoded):
            return Payload.from_value(type, raw.value if raw.kind == "array" else {}, now)
        if raw.size > FEW_BYTES and finished(has_many_values(raw.data, MAX_LENIENT_VALUES)):
            raise Refused(f"{where}: more than {MAX_LENIENT_VALUES} values: send them by their names")
        return Payload.from_args(type, raw.json(), now)
    except InvalidMessage as error:
        raise refusal(where, error) from None


def arguments_in_steps(
    type: MessageType, raw: Encodable, where: str, now: Callable[[], int]
) -> Generator[None, None, Payload]:
    """Check arguments like :func:`arguments_of`, in steps if they are a JSON object."""
    if isinstance(raw, RawJson) and raw.kind == "object":
        return (yield from payload_in_steps(type, raw, where, now))
    yield
    return arguments_of(type, raw, where, now)


def refusal(where: str, error: InvalidMessage) -> Refused:
    """Return the refusal of a payload that does not fit its type; its path starts with `where`."""
    path = f"{where}.{error.path}" if error.path else where
    return Refused(f"{path}: {error.reason}")


def failure_text(values: Encodable | str, instead: str) -> str:
    """Return a provider's failure text: a string as it is, anything else as JSON (SVP-05)."""
    if isinstance(values, str):
        return values or instead
    if isinstance(values, Decoded):
        return msgspec.json.encode(values.value, enc_hook=repr).decode() if values.value else instead
    return instead if values == EMPTY else bytes(values.json()).decode()


def object_or_empty(values: Encodable | str) -> Encodable:
    """Return a provider's values; some send a string instead of none (SVP-05)."""
    return EMPTY if isinstance(values, str) else values
