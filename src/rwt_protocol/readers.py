"""Readers that validate a message's members as its op: one for each arriving op of a profile."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from types import MappingProxyType

import msgspec
from pydantic import ValidationError

from rwt_protocol.codecs.base import Members
from rwt_protocol.codecs.envelope import UNDECODED
from rwt_protocol.ops import OPS, Direction, Op, OpSpec
from rwt_protocol.ops.base import Opaque
from rwt_protocol.payloads import RawPayload
from rwt_protocol.profiles import Profile

_Convert = Callable[[msgspec.Raw | RawPayload], object]


class OpReader:
    """Converts members to one op."""

    def __init__(self, spec: OpSpec, ignored: frozenset[str]) -> None:
        self.model = spec.model
        self.in_session = spec.in_session
        self._ignored = tuple(ignored)
        # The validator itself: `model_validate` adds a call per message.
        self._validate: Callable[[Members], Op] = spec.model.__pydantic_validator__.validate_python
        self._payloads = _converters(spec.model)
        self._optional = tuple(n for n, field in spec.model.model_fields.items() if not field.is_required())

    def read(self, members: Members) -> Op:
        """Return the validated op. Consumes `members`.

        Raises:
            ValidationError: a member is missing or wrong.
            msgspec.DecodeError, UnicodeDecodeError: a text member among the payloads is not a string.
        """
        for name, convert in self._payloads:
            if name in members:
                members[name] = convert(members[name])  # type: ignore[arg-type]  # codecs leave these members as Raw or RawPayload
        # Removed before validation: the model knows members of all versions and would check these, too.
        for name in self._ignored:
            members.pop(name, None)
        try:
            return self._validate(members)
        except ValidationError:
            # Null stands for an absent member (STA-07, SUB-11): rare, so only handled on failure.
            nulls = [name for name in self._optional if name in members and members[name] is None]
            if not nulls:
                raise
            for name in nulls:
                del members[name]
            return self._validate(members)


@cache
def readers(profile: Profile, direction: Direction) -> Mapping[object, OpReader]:
    """Return the readers of the ops that arrive in one direction, by name."""
    return MappingProxyType(
        {
            name: OpReader(OPS[name], profile.without.get(name, frozenset()))
            for name in profile.arriving(direction)
        }
    )


def _converters(model: type[Op]) -> tuple[tuple[str, _Convert], ...]:
    """Return the converters of the members that arrive undecoded."""
    found: list[tuple[str, _Convert]] = []
    for name, field in model.model_fields.items():
        marks = [item for item in field.metadata if isinstance(item, Opaque)]
        # A model's own mark wins over the table of undecoded names.
        if marks:
            found.append((name, marks[0].convert))
        elif name in UNDECODED:
            found.append((name, _decoded))
    return tuple(found)


def _decoded(raw: msgspec.Raw | RawPayload) -> object:
    """Decode a member that is text in this op, but a payload in another."""
    return msgspec.json.decode(raw) if isinstance(raw, msgspec.Raw) else raw.plain()
