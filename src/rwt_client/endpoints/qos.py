"""Quality of service as programs write it."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import ValidationError

from rwt_program.errors import InvalidMessage
from rwt_protocol.error_text import explain
from rwt_protocol.ops import Qos, Subscribe


def qos_of(value: Qos | Mapping[str, object] | None) -> Qos | None:
    """The model of `value`, checked before anything is sent.

    Raises:
        InvalidMessage: a policy is not one; says which, and what it may be.
    """
    if value is None or isinstance(value, Qos):
        return value
    try:
        return Subscribe.model_validate({"topic": "", "qos": dict(value)}).qos
    except ValidationError as error:
        reason = explain("subscribe", Subscribe, error).removeprefix("subscribe.")
    raise InvalidMessage("", reason)
