"""`rclpy.lifecycle`: managed nodes.

The states and transitions are those of ROS 2's design article "Managed nodes".
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Any, Final, NamedTuple

from rwt_rclpy.endpoints.publisher import Publisher
from rwt_rclpy.endpoints.qos import QoSProfile
from rwt_rclpy.exceptions import RCLError
from rwt_rclpy.logs.logger import get_logger
from rwt_rclpy.messages.loaded import classes, message_class
from rwt_rclpy.nodes.node import Node
from rwt_rclpy.release import FROM_KILTED


class TransitionCallbackReturn(Enum):
    """Result of a transition callback, with the numbers of `lifecycle_msgs/Transition`."""

    SUCCESS = 97
    FAILURE = 98
    ERROR = 99

    def to_label(self) -> str:
        """Return the label of the transition that follows."""
        return f"transition_{self.name.lower()}"


TransitionCallbackReturn.__name__ = TransitionCallbackReturn.__qualname__ = "TransitionCallbackReturnType"


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


#: Transitions in rcl's order: id, label, start, goal.
_TRANSITIONS: Final = (
    (1, "configure", 1, 10),
    (10, "transition_success", 10, 2), (11, "transition_failure", 10, 1), (12, "transition_error", 10, 15),
    (2, "cleanup", 2, 11),
    (20, "transition_success", 11, 1), (21, "transition_failure", 11, 2), (22, "transition_error", 11, 15),
    (3, "activate", 2, 13),
    (30, "transition_success", 13, 3), (31, "transition_failure", 13, 2), (32, "transition_error", 13, 15),
    (4, "deactivate", 3, 14),
    (40, "transition_success", 14, 2), (41, "transition_failure", 14, 3), (42, "transition_error", 14, 15),
    (5, "shutdown", 1, 12), (6, "shutdown", 2, 12), (7, "shutdown", 3, 12),
    (50, "transition_success", 12, 4), (51, "transition_failure", 12, 4), (52, "transition_error", 12, 15),
    (60, "transition_success", 15, 1), (61, "transition_failure", 15, 4), (62, "transition_error", 15, 4),
)  # fmt: skip
#: Callbacks by the state in which they run.
_CALLBACKS: Final = {
    10: "on_configure", 11: "on_cleanup", 12: "on_shutdown", 13: "on_activate", 14: "on_deactivate",
    15: "on_error",
}  # fmt: skip

#: Id, label, start, label of the start, goal, label of the goal.
Description = tuple[int, str, int, str, int, str]


class StateMachine:
    """State of a node, and the transitions that it allows."""

    def __init__(self, on_change: Callable[[int, int], None]) -> None:
        self._state = 1
        self._on_change = on_change
        self.initialized = True

    @property
    def current_state(self) -> tuple[int, str]:
        """Number and label of the state."""
        return self._state, _STATES[self._state]

    @property
    def available_states(self) -> list[tuple[int, str]]:
        """Numbers and labels of all states."""
        return list(_STATES.items())

    @property
    def available_transitions(self) -> list[Description]:
        """Transitions of the present state."""
        return [each for each in self.transition_graph if each[2] == self._state]

    @property
    def transition_graph(self) -> list[Description]:
        """All transitions."""
        return [
            (number, label, start, _STATES[start], goal, _STATES[goal])
            for number, label, start, goal in _TRANSITIONS
        ]

    def get_transition_by_label(self, label: str) -> int:
        """Return the number of a transition of the present state. Raises RCLError."""
        for number, name, start, _ in _TRANSITIONS:
            if start == self._state and name == label:
                return number
        raise RCLError(f"Failed to find transition '{label}' of state {_STATES[self._state]}")

    def trigger_transition_by_id(self, transition_id: int, publish: bool = True) -> None:
        """Change the state. Raises RCLError if the transition is not possible in the present one."""
        for number, _, start, goal in _TRANSITIONS:
            if start == self._state and number == transition_id:
                self._state = goal
                if publish:
                    self._on_change(start, goal)
                return
        state = _STATES[self._state]
        logger = get_logger("rcl_lifecycle")
        logger.warning(f"No transition matching {transition_id} found for current state {state}")
        if FROM_KILTED:
            raise RCLError(
                f"Unable to start transition {transition_id} from current state ({self._state}, '{state}')"
            )
        raise RCLError("Failed to trigger lifecycle state machine transition: Transition is not registered.")

    def trigger_transition_by_label(self, label: str, publish: bool = True) -> None:
        """Change the state. Raises RCLError if the transition is not possible in the present one."""
        self.trigger_transition_by_id(self.get_transition_by_label(label), publish)


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
            def call(self: SimpleManagedEntity, *args: Any, **kwargs: Any) -> None:
                # Without the method's result, as in rclpy.
                if self._enabled:
                    method(self, *args, **kwargs)
                elif when_not_enabled is not None:
                    when_not_enabled()

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
        self._state_machine = StateMachine(self._announce)
        self._managed_entities: list[ManagedEntity] = []
        self._transition_events: Publisher | None = None
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
        """Configure. Raises RCLError if the state does not allow it, before ROS 2 Kilted."""
        return self._change_state(1)

    def trigger_cleanup(self) -> TransitionCallbackReturn:
        """Clean up the node. Raises RCLError if the state does not allow this."""
        return self._change_state(2)

    def trigger_activate(self) -> TransitionCallbackReturn:
        """Activate the node. Raises RCLError if the state does not allow this."""
        return self._change_state(3)

    def trigger_deactivate(self) -> TransitionCallbackReturn:
        """Deactivate the node. Raises RCLError if the state does not allow this."""
        return self._change_state(4)

    def trigger_shutdown(self) -> TransitionCallbackReturn:
        """Shut down the node. Raises RCLError if the state does not allow this."""
        return self._change_state(self._state_machine.get_transition_by_label("shutdown"))

    def _change_state(self, transition_id: int) -> TransitionCallbackReturn:
        machine = self._state_machine
        number, label = machine.current_state
        start = LifecycleState(label, number)
        try:
            machine.trigger_transition_by_id(transition_id)
        except RCLError as error:
            if not FROM_KILTED:
                raise
            self._self.get_logger().error(str(error))
            return TransitionCallbackReturn.ERROR
        outcome = self._run(start)
        # An outcome of another class leaves the node in the transition, as on ROS.
        machine.trigger_transition_by_label(outcome.to_label())
        if outcome is TransitionCallbackReturn.ERROR:
            machine.trigger_transition_by_label(self._run(start).to_label())
        return outcome

    def _announce(self, before: int, after: int) -> None:
        if self._transition_events is not None:
            self._transition_events.publish(
                self._transition_events.msg_type(start_state=_state(before), goal_state=_state(after))
            )

    def _run(self, start: LifecycleState) -> TransitionCallbackReturn:
        name = _CALLBACKS[self._state_machine.current_state[0]]
        try:
            outcome: TransitionCallbackReturn = getattr(self, name)(start)
        except Exception as error:
            self._self.get_logger().error(f"{name} raised {type(error).__name__}: {error}")
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
        """Let the entities process the error."""
        return self._of_entities("on_error", state)

    # Entities

    def add_managed_entity(self, entity: ManagedEntity) -> None:
        """Add an entity that follows the states. Raises TypeError for what is no ManagedEntity."""
        if not isinstance(entity, ManagedEntity):
            raise TypeError("Expected a rclpy.lifecycle.ManagedEntity instance.")
        self._managed_entities.append(entity)

    def create_lifecycle_publisher(
        self, msg_type: Any, topic: str, qos_profile: QoSProfile | int, **kwargs: Any
    ) -> Any:
        """A publisher that publishes only while the node is active."""
        publisher = Node.create_publisher(
            self._self, msg_type, topic, qos_profile, publisher_class=LifecyclePublisher, **kwargs
        )
        publisher._enabled = self._state_machine.current_state[0] == 3
        self.add_managed_entity(publisher)
        return publisher

    def destroy_lifecycle_publisher(self, publisher: LifecyclePublisher) -> bool:
        """Destroy a lifecycle publisher. Returns False if it is not of this node."""
        if publisher in self._managed_entities:
            self._managed_entities.remove(publisher)
        return Node.destroy_publisher(self._self, publisher)

    # Services

    def _on_change_state(self, request: Any, response: Any) -> Any:
        wanted = request.transition.id
        if request.transition.label:
            try:
                wanted = self._state_machine.get_transition_by_label(request.transition.label)
            except RCLError as error:
                self._self.get_logger().debug(str(error))
                return response
        response.success = self._change_state(wanted) is TransitionCallbackReturn.SUCCESS
        return response

    def _on_get_state(self, request: Any, response: Any) -> Any:
        response.current_state = _state(self._state_machine.current_state[0])
        return response

    def _on_states(self, request: Any, response: Any) -> Any:
        response.available_states = [_state(number) for number in _STATES]
        return response

    def _on_transitions(self, request: Any, response: Any) -> Any:
        response.available_transitions = list(map(_description, self._state_machine.available_transitions))
        return response

    def _on_graph(self, request: Any, response: Any) -> Any:
        response.available_transitions = list(map(_description, self._state_machine.transition_graph))
        return response


def _state(number: int) -> Any:
    return message_class("lifecycle_msgs/State")(id=number, label=_STATES[number])


def _description(described: Description) -> Any:
    number, label, start, _, goal, _ = described
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
