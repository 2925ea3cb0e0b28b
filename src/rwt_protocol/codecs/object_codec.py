"""Messages as plain objects: what CBOR and BSON, which decode a frame as a whole, have in common."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import BaseModel

from rwt_protocol.codecs.base import Members
from rwt_protocol.codecs.envelope import RELIED_ON, UNDECODED
from rwt_protocol.decoded import Decoded, plain_value
from rwt_protocol.ops import Op
from rwt_protocol.rawjson import RawJson


def members_of(found: Mapping[object, object] | Mapping[str, object], size: int) -> Members:
    """The members of a decoded message of `size` bytes: those whose names are text."""
    return {
        name: Decoded(value, size) if name in UNDECODED else value
        for name, value in found.items()
        if isinstance(name, str)
    }


def message_of(op: Op) -> dict[str, object]:
    """One op as plain objects, its members in the order of the model.

    Raises:
        MalformedPayload: its payload came from another peer, and is not JSON.
    """
    message: dict[str, object] = {"op": op.op}
    for name, value in op:
        if isinstance(value, RawJson | Decoded):
            message[name] = plain_value(value)
        elif (name in op.model_fields_set or name in RELIED_ON) and value is not None:
            message[name] = value.model_dump(exclude_none=True) if isinstance(value, BaseModel) else value
    return message
