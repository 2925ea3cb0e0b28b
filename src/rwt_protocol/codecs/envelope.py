"""The decoder that takes a JSON object apart: scalars decoded, payloads left as they are."""

from __future__ import annotations

from typing import Any, Final, TypedDict

import msgspec

from rwt_protocol.codecs.base import Members
from rwt_protocol.ops import OPS, Op
from rwt_protocol.ops.base import Opaque

_FIRST: Final = ("op", "id", "topic", "msg", "service", "type", "args", "values", "result", "latch")
"""Members in the order in which clients send them: a decoder finds a member fastest where it expects it."""

_OTHERS: Final = ("receiver",)
"""Members of no op that are looked at: a message of rosbridge v1 has this one (ENV-04)."""


def payload_names(model: type[Op]) -> frozenset[str]:
    """The members of `model` that hold undecoded JSON."""
    return frozenset(
        name
        for name, field in model.model_fields.items()
        if any(isinstance(item, Opaque) for item in field.metadata)
    )


PAYLOADS: Final = {name: payload_names(spec.model) for name, spec in OPS.items()}
"""The members of each op that hold undecoded JSON."""

RELIED_ON: Final = frozenset({"result", "status"})
"""Members that readers need even where they hold what is usual (CLI-01, ACT-03)."""

UNDECODED: Final = frozenset[str]().union(*PAYLOADS.values())
"""The members that hold undecoded JSON in some op."""


def _decoder(other: Any) -> msgspec.json.Decoder[Members]:
    """One decoder for all ops: with a type per op the name of the op would have to come first to be cheap.

    Args:
        other: what it makes of the members that are no payloads.
    """
    names = dict.fromkeys(
        (*_FIRST, *(name for spec in OPS.values() for name in spec.model.model_fields), *_OTHERS)
    )
    # The key "msg" is a payload in one op and a text in another, so it is left undecoded in both.
    kinds: dict[str, Any] = {name: msgspec.Raw if name in UNDECODED else other for name in names}
    return msgspec.json.Decoder(TypedDict("AnyOp", kinds, total=False))  # type: ignore[operator]  # made at run time


DECODER: Final = _decoder(Any)
"""Takes the members that some op has; others are skipped (ENV-01). Of equal keys the last counts."""

RAW_DECODER: Final = _decoder(msgspec.Raw)
"""Takes the same members, and decodes none."""
