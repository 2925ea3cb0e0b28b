"""Decoder of the JSON envelope: decodes scalars and keeps payloads undecoded."""

from __future__ import annotations

from typing import Any, Final, TypedDict

import msgspec

from rwt_protocol.codecs.base import Members
from rwt_protocol.ops import OPS, Op
from rwt_protocol.ops.base import Opaque

_FIRST: Final = ("op", "id", "topic", "msg", "service", "type", "args", "values", "result", "latch")
"""Members in the order of most clients: decoding is fastest in the expected order."""

_OTHERS: Final = ("receiver",)
"""Members of no op that are inspected: marks of a rosbridge v1 message (ENV-04)."""


def payload_names(model: type[Op]) -> frozenset[str]:
    """Return the members of `model` that hold undecoded JSON."""
    return frozenset(
        name
        for name, field in model.model_fields.items()
        if any(isinstance(item, Opaque) for item in field.metadata)
    )


PAYLOADS: Final = {name: payload_names(spec.model) for name, spec in OPS.items()}
"""Members of each op that hold undecoded JSON."""

RELIED_ON: Final = frozenset({"result", "status"})
"""Members that are written even with their default value, because readers need them (CLI-01, ACT-03)."""

UNDECODED: Final = frozenset[str]().union(*PAYLOADS.values())
"""Members that hold undecoded JSON in at least one op."""


def _decoder(other: Any) -> msgspec.json.Decoder[Members]:
    """Return one decoder for all ops: a type per op is only fast if the op's name comes first.

    `other` is the type of members that are not payloads.
    """
    # A dict keeps the order of the first occurrence, which a set would lose.
    names = dict.fromkeys(
        (*_FIRST, *(name for spec in OPS.values() for name in spec.model.model_fields), *_OTHERS)
    )
    # The key "msg" is a payload in one op and a string in another, so it stays undecoded in both.
    kinds: dict[str, Any] = {name: msgspec.Raw if name in UNDECODED else other for name in names}
    return msgspec.json.Decoder(TypedDict("AnyOp", kinds, total=False))  # type: ignore[operator]  # mypy knows only TypedDicts with literal members


DECODER: Final = _decoder(Any)
"""Decoder of the members that occur in any op; others are skipped (ENV-01). The last of equal keys wins."""

RAW_DECODER: Final = _decoder(msgspec.Raw)
"""Decoder of the same members that leaves all of them undecoded."""
