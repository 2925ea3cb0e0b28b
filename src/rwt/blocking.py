"""A node for scripts and notebooks: its methods wait, and the server runs in a thread behind it.

>>> with Server("ws://127.0.0.1:9090") as robot:
...     robot.advertise_service("/beep", "std_srvs/Trigger", lambda request: {"success": True})
...     robot.publish("/battery", {"data": 12.6}, "std_msgs/Float32")

Callbacks and handlers run in that thread. They should be quick; a method that waits raises
:exc:`~rwt_graph.errors.WrongThread` there, because what it waits for could not come.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import anyio

from rwt_graph.errors import NotRunning
from rwt_graph.program.endpoints import TopicPublisher, TopicSubscription
from rwt_interfaces.errors import UnknownType
from rwt_program.errors import CallTimeout
from rwt_program.messages import Message, MessageCallback, MessageLike
from rwt_program.qos import BEST_AVAILABLE, QoS

if TYPE_CHECKING:
    from rwt.server import Server
    from rwt_graph.parameters.tree import Value
    from rwt_graph.program.goals import AcceptGoal, Execute, GoalHandle
    from rwt_graph.program.node import Handle, Node
    from rwt_graph.program.service_handlers import ServiceHandler
    from rwt_program.goals import GoalStatus


class BlockingSubscription:
    """The messages of a topic, as an iterator that waits for each.

    Attributes:
        topic: absolute name.
    """

    def __init__(self, node: Node, inner: TopicSubscription) -> None:
        self.topic = inner.topic
        self._node = node
        self._inner = inner

    @property
    def dropped(self) -> int:
        """Messages that were dropped because nobody took them in time."""
        return self._inner.dropped

    def get(self, timeout: float | None = None) -> Message:
        """The next message.

        Args:
            timeout: seconds of real time; None waits as long as it takes.

        Raises:
            CallTimeout: none came in time.
            NotRunning: the subscription was closed, or the graph was left.
            WrongThread: called in a callback, on the graph's own thread.
        """

        async def take() -> Message:
            try:
                with anyio.fail_after(timeout):
                    return await anext(self._inner)
            except StopAsyncIteration:
                raise NotRunning(f"the subscription of {self.topic} was closed") from None
            except TimeoutError:
                raise CallTimeout(f"no message on {self.topic} within {timeout:g} s") from None

        return self._node.run_blocking(take)

    def close(self) -> None:
        """Leave the topic."""
        self._inner.close()

    def __iter__(self) -> BlockingSubscription:
        return self

    def __next__(self) -> Message:
        try:
            return self.get()
        except NotRunning:
            raise StopIteration from None

    def __enter__(self) -> BlockingSubscription:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class BlockingGoal:
    """A goal that was sent.

    Attributes:
        id: 32 hex digits.
    """

    def __init__(self, node: Node, inner: GoalHandle) -> None:
        self.id = inner.id
        self._node = node
        self._inner = inner

    @property
    def status(self) -> GoalStatus:
        """The last state that was heard of."""
        return self._inner.status

    def result(self) -> tuple[GoalStatus, Message]:
        """Wait for the goal's end: its state then, and its result; see :meth:`GoalHandle.result`."""
        return self._node.run_blocking(self._inner.result)

    def cancel(self) -> None:
        """Ask the server to cancel; the outcome comes as the result."""
        self._node.run_blocking(self._inner.cancel)


class BlockingNode:
    """A node whose methods wait; see :class:`rwt_graph.Node`.

    Attributes:
        node: the node itself, with everything that is not here.
        server: the server whose graph it is in.
    """

    def __init__(self, node: Node, server: Server) -> None:
        self.node = node
        self.server = server
        self._publishers: dict[str, TopicPublisher] = {}

    # Topics

    def advertise(self, topic: str, type: str, qos: QoS | None = None, latch: bool = False) -> TopicPublisher:
        """Become a publisher of a topic; see :meth:`rwt_graph.Node.advertise`."""
        return self.node.advertise(topic, type, qos, latch)

    def publish(self, topic: str, message: MessageLike, type: str | None = None, latch: bool = False) -> None:
        """Publish one message, as a publisher of the topic from the first one on.

        Args:
            topic: its name.
            message: checked and completed by the topic's type.
            type: that type; may be left out after the first message, or where the topic has one.
            latch: of the first message: keep the last message for whoever joins late.

        Raises:
            UnknownType: no such message is known, or the topic has no type yet and none is given.
            TypeConflict: the topic is established with another type.
            InvalidMessage: the message does not fit the type.
        """
        name = self.node.resolve(topic)
        publisher = self._publishers.get(name)
        if publisher is None:
            known = self.node.graph.topic(name)
            if type is None and known is not None and known.type is not None:
                type = known.type.name
            if type is None:
                raise UnknownType(
                    f"{name} has no type yet: say it with its first message, for example std_msgs/String"
                )
            publisher = self._publishers[name] = self.node.advertise(name, type, latch=latch)
        elif type is not None and self.node.registry.message(type) is not publisher.type:
            publisher = self.node.advertise(name, type)  # Raises what is wrong with it.
        publisher.publish(message)

    def subscribe(
        self, topic: str, callback: MessageCallback, type: str | None = None, qos: QoS = BEST_AVAILABLE
    ) -> TopicSubscription:
        """Call `callback` with each message, in the server's thread; as :meth:`rwt_graph.Node.subscribe`."""
        return self.node.subscribe(topic, callback, type, qos)

    def topic(
        self, topic: str, type: str | None = None, qos: QoS = BEST_AVAILABLE, queue_size: int = 10
    ) -> BlockingSubscription:
        """The messages of a topic, as an iterator; see :meth:`rwt_graph.Node.subscribe`."""
        return BlockingSubscription(
            self.node, self.node.subscribe(topic, type=type, qos=qos, queue_size=queue_size)
        )

    def once(self, topic: str, type: str | None = None, timeout: float | None = None) -> Message:
        """The next message of a topic, or the one that it keeps for late joiners; see
        :meth:`BlockingSubscription.get`."""
        with self.topic(topic, type) as messages:
            return messages.get(timeout)

    # Services and actions

    def advertise_service(self, service: str, type: str, handler: ServiceHandler) -> Handle:
        """Offer a service; the handler runs in the server's thread; see
        :meth:`rwt_graph.Node.advertise_service`."""
        return self.node.advertise_service(service, type, handler)

    def call(self, service: str, request: MessageLike | None = None, timeout: float | None = None) -> Message:
        """Call a service and wait for its response; see :meth:`rwt_graph.Node.call_service`."""
        return self.node.run_blocking(lambda: self.node.call_service(service, request, timeout))

    def advertise_action(
        self, action: str, type: str, execute: Execute, accept: AcceptGoal | None = None
    ) -> Handle:
        """Offer an action; `execute` is a coroutine function and runs on the server's event loop; see
        :meth:`rwt_graph.Node.advertise_action`."""
        return self.node.advertise_action(action, type, execute, accept)

    def send_goal(
        self,
        action: str,
        goal: MessageLike | None = None,
        on_feedback: Callable[[Message], None] | None = None,
    ) -> BlockingGoal:
        """Send a goal and wait until the server has taken it; see :meth:`rwt_graph.Node.send_goal`."""
        handle = self.node.run_blocking(lambda: self.node.send_goal(action, goal, on_feedback))
        return BlockingGoal(self.node, handle)

    # Parameters

    def get_param(self, name: str) -> Value:
        """The value of a parameter of any node; see :meth:`rwt_graph.Node.get_param`."""
        return self.node.run_blocking(lambda: self.node.get_param(name))

    def set_param(self, name: str, value: Value) -> None:
        """Set a parameter of any node; see :meth:`rwt_graph.Node.set_param`."""
        self.node.run_blocking(lambda: self.node.set_param(name, value))

    # Time

    def spin(self) -> None:
        """Wait until Ctrl-C is pressed or the server has nobody left to serve (see :meth:`Server.ended`).

        Raises:
            WrongThread: called in a callback, on the graph's own thread.
        """
        try:
            self.node.run_blocking(self.server.ended)
        except KeyboardInterrupt:
            return


__all__ = ["BlockingGoal", "BlockingNode", "BlockingSubscription"]
