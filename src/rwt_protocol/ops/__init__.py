"""Ops of rosbridge v2: a frozen model for each, and the closed table of all."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Final, Union

from pydantic import Field

from rwt_protocol.ops import actions, control, services, topics
from rwt_protocol.ops.actions import ActionFeedback as ActionFeedback
from rwt_protocol.ops.actions import ActionResult as ActionResult
from rwt_protocol.ops.actions import AdvertiseAction as AdvertiseAction
from rwt_protocol.ops.actions import CancelActionGoal as CancelActionGoal
from rwt_protocol.ops.actions import SendActionGoal as SendActionGoal
from rwt_protocol.ops.actions import UnadvertiseAction as UnadvertiseAction
from rwt_protocol.ops.base import Direction as Direction
from rwt_protocol.ops.base import Op as Op
from rwt_protocol.ops.base import OpSpec as OpSpec
from rwt_protocol.ops.base import ReplyTo as ReplyTo
from rwt_protocol.ops.control import Auth as Auth
from rwt_protocol.ops.control import Fragment as Fragment
from rwt_protocol.ops.control import Png as Png
from rwt_protocol.ops.control import SetLevel as SetLevel
from rwt_protocol.ops.control import Status as Status
from rwt_protocol.ops.services import AdvertiseService as AdvertiseService
from rwt_protocol.ops.services import CallService as CallService
from rwt_protocol.ops.services import ServiceResponse as ServiceResponse
from rwt_protocol.ops.services import UnadvertiseService as UnadvertiseService
from rwt_protocol.ops.topics import Advertise as Advertise
from rwt_protocol.ops.topics import Publish as Publish
from rwt_protocol.ops.topics import Qos as Qos
from rwt_protocol.ops.topics import Subscribe as Subscribe
from rwt_protocol.ops.topics import Unadvertise as Unadvertise
from rwt_protocol.ops.topics import Unsubscribe as Unsubscribe

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
