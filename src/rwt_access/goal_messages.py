"""Goals that clients send as messages, as on ROS 1: what runs of them is charged to who sent it (ALB-01)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from rwt_access.errors import QuotaExceeded
from rwt_graph.accounts import WORK_ACCOUNT
from rwt_program.errors import CallFailed

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt_access.quotas import Charge, ClientQuotas
    from rwt_delivery.counters import TopicCounts
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.structs import MessageType


class Inner(Protocol):
    """What publishes on a topic."""

    topic: str
    type: MessageType
    counts: TopicCounts

    def publish(self, payload: Payload) -> None:
        """Hand on a message."""


class GoalAccount:
    """The account of one client's goals that are sent as messages (ALB-01); satisfies
    :class:`rwt_graph.accounts.WorkAccount`."""

    __slots__ = ("_quotas",)

    def __init__(self, quotas: ClientQuotas) -> None:
        self._quotas = quotas

    def hold(self, size: int) -> Callable[[], None]:
        """Charge a goal of so many bytes until what is returned is called.

        Raises:
            CallFailed: the client has as many calls and goals under way, or as many bytes kept, as it may.
        """
        charges: list[Charge] = []

        def release() -> None:
            for charge in charges:
                charge.end()

        try:
            charges.append(self._quotas.calls.take())
            charges.append(self._quotas.kept.take(size))
        except QuotaExceeded as exceeded:
            release()
            raise CallFailed(str(exceeded)) from None
        return release


class GoalMessages:
    """A publisher of a topic whose messages are goals, for one client: goals that run are charged to it."""

    __slots__ = ("_account", "_inner", "counts", "topic", "type")

    def __init__(self, inner: Inner, account: GoalAccount) -> None:
        self._inner = inner
        self._account = account
        self.topic = inner.topic
        self.type = inner.type
        self.counts = inner.counts

    def publish(self, payload: Payload) -> None:
        """Hand on a goal.

        Raises:
            QuotaExceeded: it would be kept, and as many bytes are kept for the client as may be.
        """
        asker = WORK_ACCOUNT.set(self._account)
        try:
            self._inner.publish(payload)
        finally:
            WORK_ACCOUNT.reset(asker)
