"""Action servers and clients."""

import threading
import time
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from test_msgs.action import Fibonacci

from differential.steps import QUIET_S, node, public, spinner, tell, wait


def _fibonacci(goal: Any) -> Any:
    result = Fibonacci.Result()
    sequence = [0, 1]
    while len(sequence) < goal.request.order:
        sequence.append(sequence[-1] + sequence[-2])
        goal.publish_feedback(Fibonacci.Feedback(sequence=sequence))
    goal.succeed()
    result.sequence = sequence
    return result


def _result_of(execute: Any, *, order: int = 4, **options: Any) -> None:
    with node() as made, spinner(made) as spin:
        server = ActionServer(made, Fibonacci, "action", execute, **options)
        client = ActionClient(made, Fibonacci, "action")
        client.wait_for_server(5)
        future = client.send_goal_async(Fibonacci.Goal(order=order))
        spin(future.done)
        handle = future.result()
        print(handle.accepted)
        if handle.accepted:
            result = handle.get_result_async()
            done = spin(result.done, 3)
            print(done, done and (result.result().status, result.result().result), handle.status)
        client.destroy()
        server.destroy()


def succeeds() -> None:
    """A goal that succeeds."""
    _result_of(_fibonacci)


def aborts() -> None:
    """A goal that is aborted."""

    def execute(goal: Any) -> Any:
        goal.abort()
        return Fibonacci.Result(sequence=[1])

    _result_of(execute)


def sets_no_state() -> None:
    """A callback that sets no state aborts."""
    _result_of(lambda goal: Fibonacci.Result(sequence=[2]))


def returns_nothing() -> None:
    """A callback that returns nothing."""

    def execute(goal: Any) -> None:
        goal.succeed()

    _result_of(execute)


def returns_wrong_type() -> None:
    """A callback that returns another class."""

    def execute(goal: Any) -> Any:
        goal.succeed()
        return Fibonacci.Feedback()

    _result_of(execute)


def raises() -> None:
    """A callback that raises."""

    def execute(goal: Any) -> Any:
        raise ZeroDivisionError("execute")

    _result_of(execute)


def succeeds_then_raises() -> None:
    """A callback that raises after it succeeded."""

    def execute(goal: Any) -> Any:
        goal.succeed()
        raise ZeroDivisionError("execute")

    _result_of(execute)


def rejected() -> None:
    """A goal that is rejected."""
    _result_of(_fibonacci, goal_callback=lambda request: GoalResponse.REJECT)


def goal_callback_returns_nothing() -> None:
    """A goal callback that returns something else."""
    _result_of(_fibonacci, goal_callback=lambda request: None)


def goal_callback_raises() -> None:
    """A goal callback that raises."""
    _result_of(_fibonacci, goal_callback=lambda request: [][0])


def coroutine() -> None:
    """A coroutine as the callback."""

    async def execute(goal: Any) -> Any:
        return _fibonacci(goal)

    _result_of(execute)


def feedback() -> None:
    """Feedback comes in order."""
    with node() as made, spinner(made) as spin:
        told: list[list[int]] = []
        server = ActionServer(made, Fibonacci, "action", _fibonacci)
        client = ActionClient(made, Fibonacci, "action")
        client.wait_for_server(5)
        future = client.send_goal_async(
            Fibonacci.Goal(order=5), feedback_callback=lambda m: told.append(list(m.feedback.sequence))
        )
        spin(future.done)
        result = future.result().get_result_async()
        spin(lambda: result.done() and len(told) == 3, 3)
        print(told)
        server.destroy()
        client.destroy()


def _cancelling(*, respond: Any = CancelResponse.ACCEPT, twice: bool = False) -> None:
    group = ReentrantCallbackGroup()

    def execute(goal: Any) -> Any:
        end = time.monotonic() + 3
        while time.monotonic() < end:
            if goal.is_cancel_requested:
                goal.canceled()
                return Fibonacci.Result(sequence=[7])
            time.sleep(0.01)
        goal.succeed()
        return Fibonacci.Result()

    with node() as made:
        executor = MultiThreadedExecutor(4)
        with spinner(made, executor=executor) as spin:
            server = ActionServer(
                made, Fibonacci, "action", execute, cancel_callback=lambda g: respond, callback_group=group
            )
            client = ActionClient(made, Fibonacci, "action", callback_group=group)
            client.wait_for_server(5)
            future = client.send_goal_async(Fibonacci.Goal(order=4))
            spin(future.done)
            handle = future.result()
            cancel = handle.cancel_goal_async()
            spin(cancel.done)
            print(cancel.result().return_code, len(cancel.result().goals_canceling))
            result = handle.get_result_async()
            print(spin(result.done), result.result().status, result.result().result)
            if twice:
                again = handle.cancel_goal_async()
                spin(again.done)
                print(again.result().return_code, len(again.result().goals_canceling))
            server.destroy()
            client.destroy()


def cancelled() -> None:
    """A goal that is cancelled."""
    _cancelling()


def cancelled_twice() -> None:
    """A cancel request after the end."""
    _cancelling(twice=True)


def cancel_rejected() -> None:
    """A cancel request that is rejected."""
    _cancelling(respond=CancelResponse.REJECT)


def cancel_of_finished_goal() -> None:
    """A cancel request for a goal that succeeded."""
    with node() as made, spinner(made) as spin:
        server = ActionServer(made, Fibonacci, "action", _fibonacci)
        client = ActionClient(made, Fibonacci, "action")
        client.wait_for_server(5)
        future = client.send_goal_async(Fibonacci.Goal(order=3))
        spin(future.done)
        result = future.result().get_result_async()
        spin(result.done)
        for _ in range(2):
            cancel = future.result().cancel_goal_async()
            spin(cancel.done)
            print(cancel.result().return_code, len(cancel.result().goals_canceling))
        server.destroy()
        client.destroy()


def cancel_requests() -> None:
    """Requests of the cancel service: unknown goals, all goals."""
    from action_msgs.srv import CancelGoal

    with node() as made, spinner(made) as spin:
        server = ActionServer(made, Fibonacci, "action", _fibonacci)
        client = made.create_client(CancelGoal, "action/_action/cancel_goal")
        client.wait_for_service(5)
        for octet in (0, 1):
            request = CancelGoal.Request()
            request.goal_info.goal_id.uuid = [octet] * 16
            future = client.call_async(request)
            spin(future.done)
            print(future.result().return_code, len(future.result().goals_canceling))
        server.destroy()


def result_of_unknown_goal() -> None:
    """A request for the result of an unknown goal."""
    with node() as made, spinner(made) as spin:
        server = ActionServer(made, Fibonacci, "action", _fibonacci)
        client = made.create_client(Fibonacci.Impl.GetResultService, "action/_action/get_result")
        client.wait_for_service(5)
        future = client.call_async(Fibonacci.Impl.GetResultService.Request())
        spin(future.done)
        print(future.result())
        server.destroy()


def blocking_calls() -> None:
    """send_goal blocks while another thread spins."""
    with node() as made:
        server = ActionServer(made, Fibonacci, "action", _fibonacci)
        client = ActionClient(made, Fibonacci, "action")
        client.wait_for_server(5)
        executor = MultiThreadedExecutor(2)
        executor.add_node(made)
        thread = threading.Thread(target=executor.spin)
        thread.start()
        response = client.send_goal(Fibonacci.Goal(order=3))
        print(response.status, response.result)
        executor.shutdown()
        thread.join()
        server.destroy()
        client.destroy()


def server_availability() -> None:
    """A server that comes and goes."""
    with node() as made:
        client = ActionClient(made, Fibonacci, "action")
        print(client.server_is_ready(), client.wait_for_server(0.1))
        server = ActionServer(made, Fibonacci, "action", _fibonacci)
        print(client.wait_for_server(5))
        server.destroy()
        print(wait(lambda: not client.server_is_ready(), 3))
        client.destroy()


def wrong_goal_types() -> None:
    """Goals of another class."""
    with node() as made:
        client = ActionClient(made, Fibonacci, "action")
        tell("none", client.send_goal_async, None)
        tell("result", client.send_goal_async, Fibonacci.Result())
        tell("blocking", client.send_goal, Fibonacci.Result())
        tell("server without callback", ActionServer, made, Fibonacci, "action", None)
        client.destroy()


def handles() -> None:
    """Public attributes."""
    with node() as made, spinner(made) as spin:
        told: list[Any] = []

        def execute(goal: Any) -> Any:
            told.append((public(goal), goal.is_active, goal.is_cancel_requested, goal.status))
            tell("cancel", goal.canceled)
            goal.succeed()
            told.append((goal.is_active, goal.status))
            tell("again", goal.succeed)
            return Fibonacci.Result()

        server = ActionServer(made, Fibonacci, "action", execute)
        client = ActionClient(made, Fibonacci, "action")
        print(public(server), public(client))
        client.wait_for_server(5)
        future = client.send_goal_async(Fibonacci.Goal(order=1))
        spin(future.done)
        print(public(future.result()), type(future.result()).__name__)
        result = future.result().get_result_async()
        spin(result.done)
        for each in told:
            print(each)
        server.destroy()
        client.destroy()


def accepted_callback() -> None:
    """Goals are executed when the program says so."""
    with node() as made, spinner(made) as spin:
        waiting: list[Any] = []
        server = ActionServer(made, Fibonacci, "action", _fibonacci, handle_accepted_callback=waiting.append)
        client = ActionClient(made, Fibonacci, "action")
        client.wait_for_server(5)
        future = client.send_goal_async(Fibonacci.Goal(order=3))
        spin(lambda: future.done() and waiting)
        result = future.result().get_result_async()
        spin(result.done, QUIET_S)
        print(result.done(), waiting[0].status)
        waiting[0].execute()
        print(spin(result.done), result.result().result)
        server.destroy()
        client.destroy()


def status_topic() -> None:
    """The status of goals."""
    from action_msgs.msg import GoalStatusArray
    from rclpy.qos import qos_profile_action_status_default

    with node() as made, spinner(made) as spin:
        told: list[list[int]] = []
        server = ActionServer(made, Fibonacci, "action", _fibonacci)
        made.create_subscription(
            GoalStatusArray,
            "action/_action/status",
            lambda m: told.append([each.status for each in m.status_list]),
            qos_profile_action_status_default,
        )
        client = ActionClient(made, Fibonacci, "action")
        client.wait_for_server(5)
        future = client.send_goal_async(Fibonacci.Goal(order=3))
        spin(future.done)
        spin(lambda: told and told[-1] == [GoalStatus.STATUS_SUCCEEDED], 3)
        print(told[-1:])
        server.destroy()
        client.destroy()


def in_the_graph() -> None:
    """Names in the graph."""
    from rclpy.action import (
        get_action_client_names_and_types_by_node,
        get_action_names_and_types,
        get_action_server_names_and_types_by_node,
    )

    with node() as made:
        server = ActionServer(made, Fibonacci, "action", _fibonacci)
        client = ActionClient(made, Fibonacci, "action")
        client.wait_for_server(5)
        print(get_action_names_and_types(made))
        print(get_action_server_names_and_types_by_node(made, "node", "/"))
        print(get_action_client_names_and_types_by_node(made, "node", "/"))
        print(sorted(name for name, _ in made.get_topic_names_and_types() if "action" in name))
        print(sorted(name for name, _ in made.get_service_names_and_types() if "action" in name))
        server.destroy()
        client.destroy()


def action_classes() -> None:
    """Classes of an action."""
    print(public(Fibonacci), public(Fibonacci.Impl))
    print(Fibonacci.Goal(order=3), Fibonacci.Result(), Fibonacci.Feedback(), Fibonacci.Impl.FeedbackMessage())
    print(Fibonacci.Impl.SendGoalService.Request())


def two_goals() -> None:
    """Goals of one client."""
    with node() as made, spinner(made) as spin:
        server = ActionServer(made, Fibonacci, "action", _fibonacci)
        client = ActionClient(made, Fibonacci, "action")
        client.wait_for_server(5)
        futures = [client.send_goal_async(Fibonacci.Goal(order=order)) for order in (3, 5)]
        spin(lambda: all(each.done() for each in futures))
        results = [each.result().get_result_async() for each in futures]
        spin(lambda: all(each.done() for each in results))
        print([list(each.result().result.sequence) for each in results])
        server.destroy()
        client.destroy()


def same_goal_id() -> None:
    """Two goals with one id."""
    from unique_identifier_msgs.msg import UUID

    with node() as made, spinner(made) as spin:
        server = ActionServer(made, Fibonacci, "action", _fibonacci)
        client = ActionClient(made, Fibonacci, "action")
        client.wait_for_server(5)
        for _ in range(2):
            future = client.send_goal_async(Fibonacci.Goal(order=3), goal_uuid=UUID(uuid=[3] * 16))
            spin(future.done)
            print(future.result().accepted)
        server.destroy()
        client.destroy()
