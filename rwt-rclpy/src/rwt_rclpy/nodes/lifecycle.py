"""`rclpy.lifecycle`: managed nodes.

The states and transitions are those of ROS 2's design article "Managed nodes".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final, NamedTuple

from rwt_rclpy.endpoints.publisher import Publisher
from rwt_rclpy.endpoints.qos import QoSProfile
from rwt_rclpy.exceptions import RCLError
from rwt_rclpy.messages.loaded import classes, message_class
from rwt_rclpy.nodes.node import Node


class TransitionCallbackReturn(IntEnum):
    """Result of a transition callback, with the numbers of `lifecycle_msgs/Transition`."""

    SUCCESS = 97
    FAILURE = 98
    ERROR = 99


class LifecycleState(NamedTuple):
    """State of a lifecycle.

    Attributes:
        label: name.
        state_id: number in `lifecycle_msgs/State`.
    """

    label: str
    state_id: int


State = LifecycleState

_STATES: Final = {
    0: "unknown", 1: "unconfigured", 2: "inactive", 3: "active", 4: "finalized",
    10: "configuring", 11: "cleaningup", 12: "shuttingdown", 13: "activating", 14: "deactivating",
    15: "errorprocessing",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Transition:
    """Transition that can be requested."""

    id: int
    label: str
    start: int
    through: int
    callback: str
    success: int
    failure: int


_TRANSITIONS: Final = (
    _Transition(1, "configure", 1, 10, "on_configure", 2, 1),
    _Transition(2, "cleanup", 2, 11, "on_cleanup", 1, 2),
    _Transition(3, "activate", 2, 13, "on_activate", 3, 2),
    _Transition(4, "deactivate", 3, 14, "on_deactivate", 2, 3),
    _Transition(5, "shutdown", 1, 12, "on_shutdown", 4, 4),
    _Transition(6, "shutdown", 2, 12, "on_shutdown", 4, 4),
    _Transition(7, "shutdown", 3, 12, "on_shutdown", 4, 4),
)
#: Automatic transitions, as listed by `get_transition_graph`: id, label, start, goal.
_INNER: Final = (
    (10, "transition_success", 10, 2), (11, "transition_failure", 10, 1), (12, "transition_error", 10, 15),
    (20, "transition_success", 11, 1), (21, "transition_failure", 11, 2), (22, "transition_error", 11, 15),
    (30, "transition_success", 13, 3), (31, "transition_failure", 13, 2), (32, "transition_error", 13, 15),
    (40, "transition_success", 14, 2), (41, "transition_failure", 14, 3), (42, "transition_error", 14, 15),
    (50, "transition_success", 12, 4), (51, "transition_failure", 12, 4), (52, "transition_error", 12, 15),
    (60, "transition_success", 15, 1), (61, "transition_failure", 15, 4), (62, "transition_error", 15, 4),
)  # fmt: skip

Callback = Callable[[LifecycleState], TransitionCallbackReturn]


class ManagedEntity:
    """Entity that follows the states of its node; by default it allows every transition."""

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Called on configuring."""
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Called on cleaning up."""
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Called on shutting down."""
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Called on activating."""
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Called on deactivating."""
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Called after an error; returns whether the node recovers."""
        return TransitionCallbackReturn.SUCCESS


class SimpleManagedEntity(ManagedEntity):
    """Entity that tracks whether its node is active."""

    def __init__(self) -> None:
        self._enabled = False

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Track the state."""
        self._enabled = True
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Track the state."""
        self._enabled = False
        return TransitionCallbackReturn.SUCCESS

    @property
    def is_activated(self) -> bool:
        """True if the node is active."""
        return self._enabled

    @staticmethod
    def when_enabled(wrapped: Any = None, *, when_not_enabled: Callable[..., Any] | None = None) -> Any:
        """Decorator of methods that are replaced while the node is inactive."""

        def decorate(method: Callable[..., Any]) -> Callable[..., Any]:
            def call(self: SimpleManagedEntity, *args: Any, **kwargs: Any) -> Any:
                if self._enabled:
                    return method(self, *args, **kwargs)
                return None if when_not_enabled is None else when_not_enabled()

            return call

        return decorate if wrapped is None else decorate(wrapped)


class LifecyclePublisher(SimpleManagedEntity, Publisher):
    """Publisher that publishes only while its node is active."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        SimpleManagedEntity.__init__(self)
        Publisher.__init__(self, *args, **kwargs)

    def publish(self, msg: Any) -> None:
        """Publish, while the node is active."""
        if self._enabled:
            Publisher.publish(self, msg)


class LifecycleNodeMixin(ManagedEntity):
    """State machine of a node, its services, and the entities that follow it."""

    _node: Node

    def __init__(self, *, enable_communication_interface: bool = True, callback_group: Any = None) -> None:
        self._state = 1
        self._managed_entities: list[ManagedEntity] = []
        self._callbacks: dict[str, Callback] = {}
        self._communicates = enable_communication_interface
        if enable_communication_interface:
            self._open_services(callback_group)

    @property
    def _self(self) -> Any:
        return self

    def _open_services(self, group: Any) -> None:
        node, names = self._self, classes()
        for short, kind, handler in (
            ("change_state", "ChangeState", self._on_change_state),
            ("get_state", "GetState", self._on_get_state),
            ("get_available_states", "GetAvailableStates", self._on_states),
            ("get_available_transitions", "GetAvailableTransitions", self._on_transitions),
            ("get_transition_graph", "GetAvailableTransitions", self._on_graph),
        ):
            node.create_service(
                names.service(f"lifecycle_msgs/{kind}"), f"~/{short}", handler, callback_group=group
            )
        self._transition_events = Node.create_publisher(
            node, message_class("lifecycle_msgs/TransitionEvent"), "~/transition_event", 1
        )

    # Transitions

    def trigger_configure(self) -> TransitionCallbackReturn:
        """Configure the node. Raises RCLError if the state does not allow this."""
        return self._trigger("configure")

    def trigger_cleanup(self) -> TransitionCallbackReturn:
        """Clean up the node. Raises RCLError if the state does not allow this."""
        return self._trigger("cleanup")

    def trigger_activate(self) -> TransitionCallbackReturn:
        """Activate the node. Raises RCLError if the state does not allow this."""
        return self._trigger("activate")

    def trigger_deactivate(self) -> TransitionCallbackReturn:
        """Deactivate the node. Raises RCLError if the state does not allow this."""
        return self._trigger("deactivate")

    def trigger_shutdown(self) -> TransitionCallbackReturn:
        """Shut down the node. Raises RCLError if the state does not allow this."""
        return self._trigger("shutdown")

    def _find(self, wanted: str | int) -> _Transition:
        for each in _TRANSITIONS:
            if each.start == self._state and wanted in (each.label, each.id):
                return each
        raise RCLError(
            f"transition {wanted!r} is not possible in state {_STATES[self._state]}; possible are"
            f" {[each.label for each in _TRANSITIONS if each.start == self._state]}"
        )

    def _trigger(self, wanted: str | int) -> TransitionCallbackReturn:
        transition = self._find(wanted)
        start = LifecycleState(_STATES[self._state], self._state)
        self._enter(transition.through, transition.id, transition.label)
        outcome = self._run(transition.callback, start)
        if outcome is TransitionCallbackReturn.SUCCESS:
            self._enter(transition.success, 0, "transition_success")
        elif outcome is TransitionCallbackReturn.FAILURE:
            self._enter(transition.failure, 0, "transition_failure")
        else:
            self._enter(15, 0, "transition_error")
            recovered = self._run("on_error", start) is TransitionCallbackReturn.SUCCESS
            label = "transition_success" if recovered else "transition_failure"
            self._enter(1 if recovered else 4, 0, label)
        return outcome

    def _enter(self, state: int, number: int, label: str) -> None:
        before, self._state = self._state, state
        if self._communicates:
            transition = message_class("lifecycle_msgs/Transition")(id=number, label=label)
            self._transition_events.publish(
                self._transition_events.msg_type(
                    transition=transition, start_state=_state(before), goal_state=_state(state)
                )
            )

    def _run(self, name: str, state: LifecycleState) -> TransitionCallbackReturn:
        callback: Callback = self._callbacks.get(name) or getattr(self, name)
        try:
            outcome: object = callback(state)
        except Exception as error:
            self._self.get_logger().error(f"{name} raised {type(error).__name__}: {error}")
            return TransitionCallbackReturn.ERROR
        if not isinstance(outcome, TransitionCallbackReturn):
            self._self.get_logger().error(f"{name} returned {outcome!r}, not a TransitionCallbackReturn")
            return TransitionCallbackReturn.ERROR
        return outcome

    def _of_entities(self, name: str, state: LifecycleState) -> TransitionCallbackReturn:
        for entity in self._managed_entities:
            outcome: TransitionCallbackReturn = getattr(entity, name)(state)
            if outcome is not TransitionCallbackReturn.SUCCESS:
                return outcome
        return TransitionCallbackReturn.SUCCESS

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure the entities."""
        return self._of_entities("on_configure", state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up the entities."""
        return self._of_entities("on_cleanup", state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Shut down the entities."""
        return self._of_entities("on_shutdown", state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate the entities."""
        return self._of_entities("on_activate", state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate the entities."""
        return self._of_entities("on_deactivate", state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Do not recover, by default."""
        return TransitionCallbackReturn.ERROR

    def _register(self, name: str, callback: Callback) -> bool:
        known = name in self._callbacks
        self._callbacks[name] = callback
        return not known

    def register_on_configure(self, callback: Callback) -> bool:
        """Replace `on_configure`. Returns False if it was replaced before."""
        return self._register("on_configure", callback)

    def register_on_cleanup(self, callback: Callback) -> bool:
        """Replace `on_cleanup`."""
        return self._register("on_cleanup", callback)

    def register_on_shutdown(self, callback: Callback) -> bool:
        """Replace `on_shutdown`."""
        return self._register("on_shutdown", callback)

    def register_on_activate(self, callback: Callback) -> bool:
        """Replace `on_activate`."""
        return self._register("on_activate", callback)

    def register_on_deactivate(self, callback: Callback) -> bool:
        """Replace `on_deactivate`."""
        return self._register("on_deactivate", callback)

    def register_on_error(self, callback: Callback) -> bool:
        """Replace `on_error`."""
        return self._register("on_error", callback)

    # Entities

    def add_managed_entity(self, entity: ManagedEntity) -> None:
        """Add an entity that follows the states."""
        self._managed_entities.append(entity)

    def create_lifecycle_publisher(
        self, msg_type: Any, topic: str, qos_profile: QoSProfile | int, **kwargs: Any
    ) -> Any:
        """A publisher that publishes only while the node is active."""
        publisher = Node.create_publisher(
            self._self, msg_type, topic, qos_profile, publisher_class=LifecyclePublisher, **kwargs
        )
        publisher._enabled = self._state == 3
        self.add_managed_entity(publisher)
        return publisher

    def destroy_lifecycle_publisher(self, publisher: LifecyclePublisher) -> bool:
        """Destroy a lifecycle publisher. Returns False if it is not of this node."""
        if publisher in self._managed_entities:
            self._managed_entities.remove(publisher)
        return Node.destroy_publisher(self._self, publisher)

    # Services

    def _on_change_state(self, request: Any, response: Any) -> Any:
        wanted = request.transition.label or request.transition.id
        try:
            outcome = self._trigger(wanted)
        except RCLError as error:
            self._self.get_logger().error(str(error))
            response.success = False
        else:
            response.success = outcome is TransitionCallbackReturn.SUCCESS
        return response

    def _on_get_state(self, request: Any, response: Any) -> Any:
        response.current_state = _state(self._state)
        return response

    def _on_states(self, request: Any, response: Any) -> Any:
        response.available_states = [_state(number) for number in _STATES]
        return response

    def _on_transitions(self, request: Any, response: Any) -> Any:
        response.available_transitions = [
            _description(each.id, each.label, each.start, each.through)
            for each in _TRANSITIONS
            if each.start == self._state
        ]
        return response

    def _on_graph(self, request: Any, response: Any) -> Any:
        asked = [_description(each.id, each.label, each.start, each.through) for each in _TRANSITIONS]
        response.available_transitions = [*asked, *(_description(*each) for each in _INNER)]
        return response


def _state(number: int) -> Any:
    return message_class("lifecycle_msgs/State")(id=number, label=_STATES[number])


def _description(number: int, label: str, start: int, goal: int) -> Any:
    return message_class("lifecycle_msgs/TransitionDescription")(
        transition=message_class("lifecycle_msgs/Transition")(id=number, label=label),
        start_state=_state(start),
        goal_state=_state(goal),
    )


class LifecycleNode(LifecycleNodeMixin, Node):
    """Managed node; override `on_configure` and the other callbacks.

    Args:
        node_name: name of the node.
        enable_communication_interface: True if other nodes may change its state.
        **kwargs: see :class:`~rwt_rclpy.nodes.node.Node`.
    """

    def __init__(self, node_name: str, *, enable_communication_interface: bool = True, **kwargs: Any) -> None:
        Node.__init__(self, node_name, **kwargs)
        LifecycleNodeMixin.__init__(self, enable_communication_interface=enable_communication_interface)


#: Name of the class in rclpy.lifecycle.
NodeMixin = LifecycleNodeMixin
