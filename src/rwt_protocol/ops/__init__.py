"""Ops of rosbridge v2: a frozen model for each, and the closed table of all."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Final, Union

from pydantic import Field

from rwt_protocol.ops import actions, control, services, topics
from rwt_protocol.ops.actions import (
    ActionFeedback,
    ActionResult,
    AdvertiseAction,
    CancelActionGoal,
    SendActionGoal,
    UnadvertiseAction,
)
from rwt_protocol.ops.base import Direction, Op, OpSpec, ReplyTo
from rwt_protocol.ops.control import Auth, Fragment, Png, SetLevel, Status
from rwt_protocol.ops.services import AdvertiseService, CallService, ServiceResponse, UnadvertiseService
from rwt_protocol.ops.topics import Advertise, Publish, Qos, Subscribe, Unadvertise, Unsubscribe

_SPECS: Final = (*control.SPECS, *topics.SPECS, *services.SPECS, *actions.SPECS)

OPS: Final[Mapping[str, OpSpec]] = MappingProxyType({spec.name: spec for spec in _SPECS})
"""All ops by their name on the wire."""


if TYPE_CHECKING:
    AnyOp = Op
    OpToServer = Op
    OpToClient = Op
else:
    # Built from the table, so that a new op cannot be missing; type checkers see the base class.
    def _union(*directions: Direction) -> object:
        models = tuple(spec.model for spec in _SPECS if spec.direction in directions)
        return Annotated[Union[models], Field(discriminator="op")]  # noqa: UP007 - `|` cannot join a tuple

    AnyOp = _union(*Direction)
    """Any op, told apart by `op`: for `pydantic.TypeAdapter`, and for members of other models."""

    OpToServer = _union(Direction.TO_SERVER, Direction.BOTH)
    """Any op that a client sends."""

    OpToClient = _union(Direction.TO_CLIENT, Direction.BOTH)
    """Any op that a server sends."""


ALIASES: Final[Mapping[str, str]] = MappingProxyType(
    {alias: spec.name for spec in _SPECS for alias in spec.aliases}
)
"""Alternative names of ops, with the name in `OPS` (X02)."""


def inbound(direction: Direction) -> frozenset[type[Op]]:
    """Return the models that need a handler where messages of `direction` arrive."""
    return frozenset(
        spec.model for spec in _SPECS if spec.direction in (direction, Direction.BOTH) and not spec.in_session
    )


__all__ = [
    "ALIASES",
    "OPS",
    "ActionFeedback",
    "ActionResult",
    "ReplyTo",
    "Advertise",
    "AdvertiseAction",
    "AdvertiseService",
    "AnyOp",
    "Auth",
    "CallService",
    "CancelActionGoal",
    "Direction",
    "Fragment",
    "Op",
    "OpSpec",
    "OpToClient",
    "OpToServer",
    "Png",
    "Publish",
    "Qos",
    "SendActionGoal",
    "ServiceResponse",
    "SetLevel",
    "Status",
    "Subscribe",
    "Unadvertise",
    "UnadvertiseAction",
    "UnadvertiseService",
    "Unsubscribe",
    "inbound",
]
