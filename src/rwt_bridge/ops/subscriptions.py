"""One client's subscriptions of one topic: several wishes, one delivery (SUB-04)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_bridge.ops.qos import kept_wanted, wishes_of
from rwt_delivery.deadline import DeadlineWatch
from rwt_delivery.drop_notices import Losses
from rwt_delivery.throttle import Gate

if TYPE_CHECKING:
    from rwt_bridge.peer import Peer
    from rwt_delivery.fanout import Channel, Fanout
    from rwt_interfaces.structs import MessageType
    from rwt_protocol import ops
    from rwt_protocol.codecs import Encoding

#: A throttle rate beyond this many milliseconds, three hundred centuries, is no longer than it.
_LONGEST_THROTTLE = 10**15


class ClientSubscription:
    """Every `subscribe` of one client under one spelling of a topic's name, by id.

    The gate follows the smallest `throttle_rate` (SUB-05), the smallest `queue_length` (X06) and the smallest
    `fragment_size` (SUB-07), and the encoding is the strongest that was asked for (SUB-08).
    """

    def __init__(self, peer: Peer, name: str, fanout: Fanout) -> None:
        self._name = name
        self._fanout = fanout
        self._bridge = peer.bridge
        self._wishes: dict[str | int | None, tuple[ops.Subscribe, Encoding]] = {}
        clock = peer.bridge.graph.clock
        self._clock = clock
        self._losses = Losses(peer, name, fanout.counts)
        self._flow = peer.sink.flow(name, on_drop=self._losses.dropped, time_ns=clock.time_ns)
        self._gate = Gate(clock, self._flow, self._losses.withheld, self._losses.dropped)
        self._encoding: Encoding | None = None
        self._channel: Channel | None = None

    @property
    def count(self) -> int:
        """How many subscriptions are held."""
        return len(self._wishes)

    @property
    def is_empty(self) -> bool:
        """Whether nothing is subscribed any more."""
        return not self._wishes

    def has(self, id_: str | int | None) -> bool:
        """Whether there is a subscription of that id."""
        return id_ in self._wishes

    def check_type(self, type: MessageType) -> None:
        """Raise `TypeConflict` unless the topic is of that type (SUB-03)."""
        self._fanout.check_type(type)

    def put(self, op: ops.Subscribe, encoding: Encoding) -> None:
        """Add a subscription, or change the one of the same id (SUB-09).

        A new one is given the kept samples of latched topics, so that a widget which joins late in a client
        that already listens sees them too (SUB-13). The first is given what came too early for it (ADV-08).
        """
        is_first, is_new = not self._wishes, op.id not in self._wishes
        self._wishes[op.id] = (op, encoding)
        channel = self._apply()
        if is_new:
            self._replay(channel, kept_wanted(op), early=is_first)

    def _replay(self, channel: Channel, most: int | None, *, early: bool) -> None:
        """Give what is kept, at most that many of the newest; None is all."""
        if most == 0:
            return
        kept = self._fanout.subscription.history()
        if early:
            kept += self._bridge.publications.early(self._fanout.topic)
        for sample in kept if most is None else kept[-most:]:
            channel.replay(sample, self._gate)

    def drop(self, id_: str | int | None) -> bool:
        """End the subscription of that id, or all of them; whether there was one."""
        if id_ is not None and id_ not in self._wishes:
            return False
        if id_ is None:
            self._wishes.clear()
        else:
            del self._wishes[id_]
        if self._wishes:
            self._apply()
        else:
            self.close()
        return True

    def close(self) -> None:
        """Stop the flow and drop what waits in the gate (DIS-01, THR-07)."""
        self._wishes.clear()
        self._gate.close()
        self._flow.close()
        self._losses.close()
        self._leave()
        self._bridge.release_fanout(self._fanout)

    def _apply(self) -> Channel:
        wishes = self._wishes.values()
        encoding = max((encoding for _, encoding in wishes), key=lambda encoding: encoding.precedence)
        self._gate.cut_to(min((op.fragment_size for op, _ in wishes if op.fragment_size), default=0))
        throttle = min(*(max(0, op.throttle_rate) for op, _ in wishes), _LONGEST_THROTTLE) / 1000
        self._gate.configure(throttle, min(op.queue_length for op, _ in wishes))
        self._apply_qos([op for op, _ in wishes])
        if encoding is self._encoding and self._channel is not None:
            self._channel.sort()
            return self._channel
        self._leave()
        self._encoding = encoding
        self._channel = self._fanout.join(self._gate, self._name, encoding)
        return self._channel

    def _apply_qos(self, subscriptions: list[ops.Subscribe]) -> None:
        info = self._bridge.graph.topic(self._fanout.topic)
        wishes = wishes_of(subscriptions, info.publishers if info else ())
        self._flow.configure(wishes.rules)
        watch = (
            DeadlineWatch(self._clock, wishes.deadline, self._losses.deadline_missed)
            if wishes.deadline
            else None
        )
        self._gate.watch(wishes.lifespan_ns, watch)

    def _leave(self) -> None:
        if self._encoding is not None:
            self._fanout.leave(self._gate, self._name, self._encoding)
            self._encoding = None
