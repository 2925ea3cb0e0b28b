"""Lifecycle nodes."""

from typing import Any

import rclpy
from lifecycle_msgs.msg import State, Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from rclpy.lifecycle import (
    LifecycleNode,
    LifecycleState,
    ManagedEntity,
    SimpleManagedEntity,
    TransitionCallbackReturn,
)
from std_msgs.msg import Int32

from differential.steps import QUIET_S, public, spinner, tell, with_logs


class _Told(LifecycleNode):
    """Prints its transitions, with prepared results."""

    def __init__(self, **results: Any) -> None:
        self.results = results
        super().__init__("node")

    def _tell(self, name: str, state: Any) -> Any:
        print(name, "from", state)
        result = self.results.get(name, TransitionCallbackReturn.SUCCESS)
        if isinstance(result, Exception):
            raise result
        return result

    def on_configure(self, state: Any) -> Any:
        """Configure."""
        return self._tell("configure", state)

    def on_cleanup(self, state: Any) -> Any:
        """Clean up."""
        return self._tell("cleanup", state)

    def on_activate(self, state: Any) -> Any:
        """Activate."""
        return self._tell("activate", state)

    def on_deactivate(self, state: Any) -> Any:
        """Deactivate."""
        return self._tell("deactivate", state)

    def on_shutdown(self, state: Any) -> Any:
        """Shut down."""
        return self._tell("shutdown", state)

    def on_error(self, state: Any) -> Any:
        """Process an error."""
        return self._tell("error", state)


def _triggers(*names: str, **results: Any) -> None:
    rclpy.init(args=[])
    made = _Told(**results)
    for name in names:
        tell(name, getattr(made, f"trigger_{name}"))
        print(made._state_machine.current_state)
    made.destroy_node()
    rclpy.shutdown()


def whole_life() -> None:
    """All transitions."""
    _triggers("configure", "activate", "deactivate", "cleanup", "configure", "shutdown")


def shutdown_from_active() -> None:
    """Shutdown of an active node."""
    _triggers("configure", "activate", "shutdown", "shutdown")


def shutdown_from_unconfigured() -> None:
    """Shutdown of a new node."""
    _triggers("shutdown")


def repeated_transition() -> None:
    """A transition that is not possible now."""
    _triggers("configure", "configure", "activate", "activate", "cleanup")


def transition_too_early() -> None:
    """Transitions of a new node."""
    _triggers("activate", "deactivate", "cleanup")


def failure() -> None:
    """A callback that fails."""
    _triggers("configure", "configure", configure=TransitionCallbackReturn.FAILURE)


def failure_of_activation() -> None:
    """A callback that fails."""
    _triggers("configure", "activate", activate=TransitionCallbackReturn.FAILURE)


def error() -> None:
    """A callback that returns an error."""
    _triggers("configure", configure=TransitionCallbackReturn.ERROR)


def error_not_handled() -> None:
    """An error that on_error cannot handle."""
    _triggers(
        "configure",
        "configure",
        configure=TransitionCallbackReturn.ERROR,
        error=TransitionCallbackReturn.FAILURE,
    )


def exception() -> None:
    """A callback that raises."""
    _triggers("configure", configure=ZeroDivisionError("configure"))


def exception_of_error() -> None:
    """Both callbacks raise."""
    _triggers("configure", configure=ZeroDivisionError("configure"), error=ZeroDivisionError("error"))


def invalid_result() -> None:
    """A callback that returns nothing leaves the node in a transition."""
    _triggers("configure", "configure", configure=None)


def invalid_result_true() -> None:
    """A callback that returns True."""
    _triggers("configure", configure=True)


def deactivate_fails() -> None:
    """A deactivation that fails."""
    _triggers("configure", "activate", "deactivate", deactivate=TransitionCallbackReturn.FAILURE)


def classes() -> None:
    """Public classes."""
    print(list(TransitionCallbackReturn.__members__.items()))
    print(TransitionCallbackReturn.SUCCESS.to_label(), TransitionCallbackReturn.SUCCESS.name)
    print(str(TransitionCallbackReturn.ERROR), TransitionCallbackReturn.SUCCESS == 0)
    print(
        LifecycleState("label", 3),
        LifecycleState(state_id=1, label="a") == LifecycleState(state_id=1, label="a"),
    )
    print(public(ManagedEntity), public(SimpleManagedEntity))
    print(
        [
            each
            for each in public(LifecycleNode)
            if "lifecycle" in each or "trigger" in each or "managed" in each
        ]
    )


def state_machine() -> None:
    """The state machine that tests look into."""
    rclpy.init(args=[])
    made = LifecycleNode("node")
    machine = made._state_machine
    print(machine.initialized, machine.current_state)
    print(public(machine))
    print(machine.available_states)
    print(machine.available_transitions)
    print(len(machine.transition_graph), machine.transition_graph[0])
    tell("label", machine.get_transition_by_label, "configure")
    tell("unknown", machine.get_transition_by_label, "none")
    made.destroy_node()
    rclpy.shutdown()


def without_services() -> None:
    """A node without its services."""
    rclpy.init(args=[])
    made = LifecycleNode("node", enable_communication_interface=False)
    print([each.srv_name for each in made.services if "state" in each.srv_name])
    tell("configure", made.trigger_configure)
    made.destroy_node()
    rclpy.shutdown()


def _call(spin: Any, made: Any, kind: Any, name: str, request: Any) -> Any:
    client = made.create_client(kind, f"node/{name}")
    client.wait_for_service(5)
    future = client.call_async(request)
    spin(future.done, 2)
    made.destroy_client(client)
    return future.result()


def services() -> None:
    """Transitions through services."""
    rclpy.init(args=[])
    made = LifecycleNode("node")
    with spinner(made) as spin:
        for options in (
            {"id": Transition.TRANSITION_CONFIGURE},
            {"label": "activate"},
            {"label": "none"},
            {"id": Transition.TRANSITION_DEACTIVATE, "label": "deactivate"},
        ):
            request = ChangeState.Request(transition=Transition(**options))
            print(options, _call(spin, made, ChangeState, "change_state", request))
            print(_call(spin, made, GetState, "get_state", GetState.Request()))
        states = _call(spin, made, GetAvailableStates, "get_available_states", GetAvailableStates.Request())
        print([(each.id, each.label) for each in states.available_states])
        for name in ("get_available_transitions", "get_transition_graph"):
            found = _call(spin, made, GetAvailableTransitions, name, GetAvailableTransitions.Request())
            for each in found.available_transitions:
                print(
                    name,
                    each.transition.label,
                    each.transition.id,
                    each.start_state.label,
                    each.goal_state.label,
                )
    made.destroy_node()
    rclpy.shutdown()


def service_of_impossible_transition() -> None:
    """A request for a transition that is not possible now."""
    rclpy.init(args=[])
    made = LifecycleNode("node")
    with spinner(made) as spin:
        request = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_ACTIVATE))
        tell("call", _call, spin, made, ChangeState, "change_state", request)
        print(made._state_machine.current_state)
    made.destroy_node()
    rclpy.shutdown()


def transition_events() -> None:
    """Events of transitions."""
    rclpy.init(args=[])
    made = LifecycleNode("node")
    told: list[Any] = []
    made.create_subscription(TransitionEvent, "node/transition_event", told.append, 10)
    with spinner(made) as spin:
        spin(seconds=0.3)
        made.trigger_configure()
        spin(lambda: len(told) == 2, 2)
        for event in told:
            print(event.transition, event.start_state, event.goal_state, event.timestamp > 0)
    made.destroy_node()
    rclpy.shutdown()


def lifecycle_publisher() -> None:
    """A publisher that publishes while its node is active."""
    rclpy.init(args=[])
    made = LifecycleNode("node")
    received: list[int] = []
    publisher = made.create_lifecycle_publisher(Int32, "topic", 10)
    made.create_subscription(Int32, "topic", lambda m: received.append(m.data), 10)
    with spinner(made) as spin:
        spin(lambda: publisher.get_subscription_count())
        for number, trigger in enumerate(("configure", "activate", "deactivate")):
            tell(trigger, getattr(made, f"trigger_{trigger}"))
            print(publisher.is_activated)
            publisher.publish(Int32(data=number))
        spin(seconds=QUIET_S)
    print(received)
    made.destroy_lifecycle_publisher(publisher)
    made.destroy_node()
    rclpy.shutdown()


def managed_entities() -> None:
    """Entities that follow the node."""

    class Entity(ManagedEntity):
        """Prints its transitions."""

        def on_configure(self, state: Any) -> Any:
            """Configure."""
            print("entity configures from", state)
            return TransitionCallbackReturn.SUCCESS

        def on_activate(self, state: Any) -> Any:
            """Activate."""
            return TransitionCallbackReturn.FAILURE

    rclpy.init(args=[])
    made = LifecycleNode("node")
    made.add_managed_entity(Entity())
    tell("other", made.add_managed_entity, object())
    tell("configure", made.trigger_configure)
    tell("activate", made.trigger_activate)
    print(made._state_machine.current_state)
    made.destroy_node()
    rclpy.shutdown()


@with_logs
def logs() -> None:
    """Lines about errors."""
    rclpy.init(args=[])
    made = _Told(configure=ZeroDivisionError("configure"))
    made.trigger_configure()
    made.destroy_node()
    rclpy.shutdown()


def simple_managed_entity() -> None:
    """Entities that are enabled while their node is active."""
    entity = SimpleManagedEntity()
    print(entity.is_activated)
    print(entity.on_activate(LifecycleState("inactive", State.PRIMARY_STATE_INACTIVE)), entity.is_activated)

    class Guarded(SimpleManagedEntity):
        """Has a method for active nodes."""

        @SimpleManagedEntity.when_enabled
        def work(self) -> str:
            """Work."""
            return "worked"

    guarded = Guarded()
    tell("disabled", guarded.work)
    guarded.on_activate(None)
    tell("enabled", guarded.work)


def default_callbacks() -> None:
    """A node without callbacks of its own, with an entity whose callbacks fail."""

    class Entity(ManagedEntity):
        def on_configure(self, state: Any) -> Any:
            print("entity configures from", state)
            return TransitionCallbackReturn.ERROR

        def on_error(self, state: Any) -> Any:
            print("entity processes an error from", state)
            return TransitionCallbackReturn.SUCCESS

    rclpy.init(args=[])
    made = LifecycleNode("node")
    for name in ("configure", "activate", "deactivate", "cleanup", "shutdown"):
        tell(name, getattr(made, f"trigger_{name}"))
    other = LifecycleNode("other")
    other.add_managed_entity(Entity())
    tell("error", other.trigger_configure)
    print(other._state_machine.current_state)
    tell("wrong entity", other.add_managed_entity, 1)
    made.destroy_node()
    other.destroy_node()
    rclpy.shutdown()


def error_of_default_callback() -> None:
    """An exception in one callback, while on_error is the default."""

    class Failing(LifecycleNode):
        def on_configure(self, state: Any) -> Any:
            raise ZeroDivisionError

        def on_activate(self, state: Any) -> Any:
            return TransitionCallbackReturn.FAILURE

    rclpy.init(args=[])
    made = Failing("node")
    tell("configure", made.trigger_configure)
    print(made._state_machine.current_state)
    tell("activate", made.trigger_activate)
    made.destroy_node()
    rclpy.shutdown()


def endpoints_of_a_managed_node() -> None:
    """Timers, subscriptions and ordinary publishers work in any state; lifecycle publishers do not."""
    rclpy.init(args=[])
    made = LifecycleNode("node")
    received: list[int] = []
    made.create_subscription(Int32, "topic", lambda message: received.append(message.data), 10)
    managed = made.create_lifecycle_publisher(Int32, "topic", 10)
    plain = made.create_publisher(Int32, "topic", 10)
    print(type(managed).__name__, type(plain).__name__, managed.is_activated)
    with spinner(made) as spin:
        spin(lambda: managed.get_subscription_count() and plain.get_subscription_count())
        for number, name in enumerate(("configure", "activate", "deactivate")):
            managed.publish(Int32(data=number))
            plain.publish(Int32(data=10 + number))
            spin(seconds=0.1)
            getattr(made, f"trigger_{name}")()
            print(name, managed.is_activated, sorted(received))
        print(made.destroy_lifecycle_publisher(managed), made.destroy_publisher(plain))
        tell("class", made.create_lifecycle_publisher, Int32, "other", 10, publisher_class=int)
    made.destroy_node()
    rclpy.shutdown()
