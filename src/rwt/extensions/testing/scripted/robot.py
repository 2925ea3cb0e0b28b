"""Scripted robot: a node with scripted answers, topics and expectations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypedDict, Unpack

from rwt.extensions.testing.errors import ScriptError
from rwt.extensions.testing.expectations import Expectation, expect, expect_soon
from rwt.extensions.testing.journal import Kind, ObservedGraph
from rwt.extensions.testing.matching import Matching
from rwt.extensions.testing.scripted.action import ScriptedAction
from rwt.extensions.testing.scripted.service import ScriptedService
from rwt.extensions.testing.scripted.topic import ScriptedTopic
from rwt_graph.names import node_name
from rwt_graph.nodes.node import Node
from rwt_participant.messages import Message, MessageLike, ParameterValue


class Bounds(TypedDict, total=False):
    """Keyword arguments of every expectation; see :meth:`ScriptedRobot.expect_published`."""

    within: float | None
    count: int | None


class ScriptedRobot(Node):
    """A :class:`~rwt_graph.nodes.node.Node` whose behaviour is scripted, one line per behaviour.

    >>> robot.on_service("/add_two_ints", "example_interfaces/AddTwoInts").returns({"sum": 5})
    >>> robot.expect_published("/cmd_vel", matching={"linear": {"x": 0.5}})

    Every method may be called from any thread while the graph runs. `expect_…` blocks, for plain tests;
    coroutines await `until_…` with the same arguments.

    Attributes:
        journal: what was received.
    """

    def __init__(self, graph: ObservedGraph, name: str = "robot") -> None:
        graph.unobserved.add(node_name(name))
        super().__init__(graph, name)
        self.journal = graph.journal
        self._topics: list[ScriptedTopic] = []
        self._services: dict[str, ScriptedService] = {}
        self._actions: dict[str, ScriptedAction] = {}

    # Behaviour

    def publishes(
        self,
        topic: str,
        type: str,
        message: MessageLike | None = None,
        *,
        messages: Sequence[MessageLike] = (),
        rate: float | None = None,
        latch: bool = False,
    ) -> ScriptedTopic:
        """Publish on a topic.

        Args:
            type: message type, for example `std_msgs/String`.
            message: published once, or repeatedly with a `rate`.
            messages: published in turn, from the first again after the last; requires a `rate`.
            rate: messages per second of the robot's clock.
            latch: True to retain the last message for late subscribers.

        Raises:
            ScriptError: a message does not fit the type, or `messages` come without `rate`.
            UnknownType: the type is unknown; also raises what :meth:`Node.advertise` raises.
        """
        if messages and (rate is None or message is not None):
            raise ScriptError(f"{topic}: `messages` need a `rate`, and no `message` beside them")
        scripted = ScriptedTopic(self.graph, self.advertise(topic, type, latch=latch))
        self._topics.append(scripted)
        if rate is not None:
            scripted.repeat(messages or ({} if message is None else message,), rate)
        elif message is not None:
            scripted.publish(message)
        return scripted

    def on_service(self, service: str, type: str) -> ScriptedService:
        """Offer a service; the methods of the result script its answers.

        A second call with the same type returns the same service: its methods change further answers.

        Raises:
            UnknownType: the type is unknown; also raises what :meth:`Node.advertise_service` raises.
        """
        name, interface = self.resolve(service), self.registry.service(type)
        scripted = self._services.get(name)
        if scripted is None or scripted.type is not interface:
            scripted = ScriptedService(name, interface, self.clock, self.journal)
            self.advertise_service(name, type, scripted.handle)
            self._services[name] = scripted
        return scripted

    def on_action(self, action: str, type: str) -> ScriptedAction:
        """Offer an action; the methods of the result script its goals.

        A second call with the same type returns the same action: its methods change how further goals run.

        Raises:
            UnknownType: the type is unknown; also raises what :meth:`Node.advertise_action` raises.
        """
        name, interface = self.resolve(action), self.registry.action(type)
        scripted = self._actions.get(name)
        if scripted is None or scripted.type is not interface:
            scripted = ScriptedAction(name, interface, self.clock, self.journal)
            self.advertise_action(name, type, scripted.execute, accept=scripted.accept)
            self._actions[name] = scripted
        return scripted

    def has_parameter(self, name: str, value: ParameterValue) -> None:
        """Set a parameter, declaring it if needed.

        Raises:
            ParameterRejected: the value has another type than before.
        """
        if not self.parameters.has(name):
            self.parameters.declare(name, value)
        if self.parameters.get(name) != value:
            self.parameters.set(name, value)

    # Expectations

    def expect_published(
        self, topic: str, matching: Matching = None, **bounds: Unpack[Bounds]
    ) -> list[Message]:
        """Wait until another node has published on a topic, and return the matching messages.

        Earlier messages count too, from the start of the robot or the last :meth:`forget`.

        Args:
            matching: some fields with their values, nested like the message, or a predicate of the message.
                Floats may differ by a millionth.
            within: seconds of real time; default: 5, or 0.2 with `count=0`, which waits to the end.
            count: exact number; None: at least one. Waiting ends at that number.

        Raises:
            AssertionError: the expectation was not met; the text shows what came instead.
            BlockingWait: called from a coroutine.
            ScriptError: `matching` names an unknown field.
        """
        __tracebackhide__ = True
        return expect(self.journal, self._expectation(Kind.MESSAGE, topic, matching, **bounds))

    async def until_published(
        self, topic: str, matching: Matching = None, **bounds: Unpack[Bounds]
    ) -> list[Message]:
        """Like :meth:`expect_published`, for coroutines."""
        __tracebackhide__ = True
        return await expect_soon(self.journal, self._expectation(Kind.MESSAGE, topic, matching, **bounds))

    def expect_called(
        self, service: str, matching: Matching = None, **bounds: Unpack[Bounds]
    ) -> list[Message]:
        """Like :meth:`expect_published`, for requests of a service from :meth:`on_service`."""
        __tracebackhide__ = True
        return expect(self.journal, self._expectation(Kind.CALL, service, matching, **bounds))

    async def until_called(
        self, service: str, matching: Matching = None, **bounds: Unpack[Bounds]
    ) -> list[Message]:
        """Like :meth:`expect_called`, for coroutines."""
        __tracebackhide__ = True
        return await expect_soon(self.journal, self._expectation(Kind.CALL, service, matching, **bounds))

    def expect_goal(self, action: str, matching: Matching = None, **bounds: Unpack[Bounds]) -> list[Message]:
        """Like :meth:`expect_published`, for goals of an action from :meth:`on_action`."""
        __tracebackhide__ = True
        return expect(self.journal, self._expectation(Kind.GOAL, action, matching, **bounds))

    async def until_goal(
        self, action: str, matching: Matching = None, **bounds: Unpack[Bounds]
    ) -> list[Message]:
        """Like :meth:`expect_goal`, for coroutines."""
        __tracebackhide__ = True
        return await expect_soon(self.journal, self._expectation(Kind.GOAL, action, matching, **bounds))

    def forget(self) -> None:
        """Clear the journal."""
        self.journal.clear()

    def close(self) -> None:
        """Stop the script, and leave the graph."""
        for topic in self._topics:
            topic.stop()
        super().close()

    def _expectation(
        self, kind: Kind, name: str, matching: Matching, **bounds: Unpack[Bounds]
    ) -> Expectation:
        return Expectation(kind, self.resolve(name), matching, **bounds)
