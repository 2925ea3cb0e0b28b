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


def _goal(spin: Any, client: Any, order: int = 4, **options: Any) -> Any:
    client.wait_for_server(5)
    future = client.send_goal_async(Fibonacci.Goal(order=order), **options)
    spin(future.done)
    return future.result()


def _status_name(number: int) -> str:
    return next(
        (
            name
            for name in dir(GoalStatus)
            if name.startswith("STATUS_") and getattr(GoalStatus, name) == number
        ),
        str(number),
    )


def _racing(execute: Any, *, before: Any = None, cancel: Any = None) -> None:
    """A goal that is cancelled while `execute` runs in a thread of its own."""
    with node() as made:
        executor = MultiThreadedExecutor(6)
        executor.add_node(made)
        thread = threading.Thread(target=executor.spin)
        thread.start()
        group = ReentrantCallbackGroup()
        server = ActionServer(
            made, Fibonacci, "action", execute, callback_group=group,
            cancel_callback=cancel or (lambda goal: CancelResponse.ACCEPT),
        )  # fmt: skip
        client = ActionClient(made, Fibonacci, "action", callback_group=group)
        client.wait_for_server(5)
        future = client.send_goal_async(Fibonacci.Goal(order=3))
        wait(future.done)
        handle = future.result()
        result = handle.get_result_async()
        if before is not None:
            before()
        answer = handle.cancel_goal_async()
        print(
            "answer",
            wait(answer.done) and (answer.result().return_code, len(answer.result().goals_canceling)),
        )
        print("result", wait(result.done, 3) and _status_name(result.result().status))
        print("status", _status_name(handle.status))
        executor.shutdown()
        thread.join()
        client.destroy()
        server.destroy()


def cancel_then_succeed() -> None:
    """The server accepts a cancellation, and succeeds all the same."""

    def execute(goal: Any) -> Any:
        wait(lambda: goal.is_cancel_requested)
        time.sleep(0.1)
        tell("succeed", goal.succeed)
        return Fibonacci.Result(sequence=[1])

    _racing(execute)


def cancel_then_abort() -> None:
    """The server accepts a cancellation, and aborts."""

    def execute(goal: Any) -> Any:
        wait(lambda: goal.is_cancel_requested)
        time.sleep(0.1)
        tell("abort", goal.abort)
        print(goal.is_active, _status_name(goal.status))
        tell("canceled after abort", goal.canceled)
        return Fibonacci.Result()

    _racing(execute)


def cancel_then_canceled() -> None:
    """The server accepts a cancellation, and reports it."""

    def execute(goal: Any) -> Any:
        wait(lambda: goal.is_cancel_requested)
        time.sleep(0.1)
        print(goal.is_active, _status_name(goal.status))
        tell("canceled", goal.canceled)
        print(goal.is_active, _status_name(goal.status))
        tell("succeed", goal.succeed)
        return Fibonacci.Result()

    _racing(execute)


def canceled_without_request() -> None:
    """The server reports a cancellation that was not requested, or was rejected."""
    ready = threading.Event()

    def execute(goal: Any) -> Any:
        tell("early", goal.canceled)
        print(_status_name(goal.status))
        ready.wait(2)
        time.sleep(0.1)
        print(goal.is_cancel_requested)
        goal.succeed()
        return Fibonacci.Result()

    def reject(goal: Any) -> CancelResponse:
        ready.set()
        return CancelResponse.REJECT

    _racing(execute, cancel=reject)


def cancel_callback_raises() -> None:
    """A cancel callback that returns something else."""
    ready = threading.Event()

    def execute(goal: Any) -> Any:
        ready.wait(2)
        time.sleep(0.1)
        print(goal.is_cancel_requested)
        goal.succeed()
        return Fibonacci.Result()

    def other(goal: Any) -> Any:
        ready.set()
        return None

    _racing(execute, cancel=other)


def states_of_a_server_goal() -> None:
    """Transitions of a goal handle on the server: each impossible one raises."""

    def execute(goal: Any) -> Any:
        print(_status_name(goal.status), goal.is_active, goal.is_cancel_requested)
        tell("executing again", goal.execute)
        tell("succeed", goal.succeed)
        for name in ("succeed", "abort", "canceled"):
            tell(name, getattr(goal, name))
        print(_status_name(goal.status), goal.is_active)
        tell("feedback", goal.publish_feedback, Fibonacci.Feedback(sequence=[1]))
        tell("wrong feedback", goal.publish_feedback, Fibonacci.Result())
        return Fibonacci.Result(sequence=[5])

    _result_of(execute)


def deferred_execution() -> None:
    """Goals that are accepted first, and executed later by the program."""
    with node() as made, spinner(made) as spin:
        waiting: list[Any] = []

        def execute(goal: Any) -> Any:
            goal.succeed()
            return Fibonacci.Result(sequence=[goal.request.order])

        server = ActionServer(made, Fibonacci, "action", execute, handle_accepted_callback=waiting.append)
        client = ActionClient(made, Fibonacci, "action")
        handles = [_goal(spin, client, order) for order in (1, 2)]
        results = [each.get_result_async() for each in handles]
        spin(lambda: len(waiting) == 2)
        spin(seconds=0.2)
        print([_status_name(each.status) for each in waiting], [each.done() for each in results])
        waiting[1].execute()
        spin(results[1].done)
        print(results[1].result().result, results[0].done())
        waiting[0].execute(lambda goal: (goal.abort(), Fibonacci.Result(sequence=[9]))[1])
        spin(results[0].done)
        print(results[0].result().result, _status_name(results[0].result().status))
        client.destroy()
        server.destroy()


def result_twice() -> None:
    """The result is asked for twice, also after it has been delivered."""
    with node() as made, spinner(made) as spin:
        server = ActionServer(made, Fibonacci, "action", _fibonacci)
        client = ActionClient(made, Fibonacci, "action")
        handle = _goal(spin, client)
        first, second = handle.get_result_async(), handle.get_result_async()
        spin(lambda: first.done() and second.done())
        print(first is second, first.result().result == second.result().result)
        third = handle.get_result_async()
        print(spin(third.done), third is first, third.result().status)
        client.destroy()
        server.destroy()


def result_expires() -> None:
    """A result that the server keeps for a short time."""
    with node() as made, spinner(made) as spin:
        server = ActionServer(made, Fibonacci, "action", _fibonacci, result_timeout=0)
        client = ActionClient(made, Fibonacci, "action")
        handle = _goal(spin, client)
        spin(seconds=0.5)
        future = handle.get_result_async()
        print(spin(future.done, 2), future.done() and future.result().status)
        client.destroy()
        server.destroy()


def destroyed_with_goals() -> None:
    """Server and client that are destroyed while a goal runs."""
    with node() as made, spinner(made) as spin:
        waiting: list[Any] = []
        server = ActionServer(made, Fibonacci, "action", _fibonacci, handle_accepted_callback=waiting.append)
        client = ActionClient(made, Fibonacci, "action")
        handle = _goal(spin, client)
        result = handle.get_result_async()
        server.destroy()
        spin(seconds=0.2)
        print(result.done(), client.server_is_ready(), client.wait_for_server(0.1))
        tell("destroy again", server.destroy)
        tell("state", waiting[0].succeed)
        client.destroy()
        tell("client again", client.destroy)
        tell("send", client.send_goal_async, Fibonacci.Goal())


def client_without_server() -> None:
    """A goal for a server that comes later, or never."""
    with node() as made, spinner(made) as spin:
        client = ActionClient(made, Fibonacci, "action")
        print(client.server_is_ready(), client.wait_for_server(timeout_sec=0.1))
        future = client.send_goal_async(Fibonacci.Goal())
        spin(seconds=0.2)
        print(future.done())
        server = ActionServer(made, Fibonacci, "action", _fibonacci)
        print(spin(client.server_is_ready), spin(future.done, 0.5))
        server.destroy()
        client.destroy()


def register_callbacks() -> None:
    """Callbacks that are replaced, and arguments that are no functions."""
    with node() as made, spinner(made) as spin:
        server = ActionServer(made, Fibonacci, "action", _fibonacci)
        tell("goal", server.register_goal_callback, None)
        tell("cancel", server.register_cancel_callback, 1)
        tell("execute", server.register_execute_callback, None)
        tell("accepted", server.register_handle_accepted_callback, 1)
        server.register_goal_callback(lambda goal: GoalResponse.REJECT)
        client = ActionClient(made, Fibonacci, "action")
        handle = _goal(spin, client)
        print(handle.accepted, type(handle.goal_id).__name__, handle.stamp)
        tell("cancel of rejected", lambda: handle.cancel_goal_async().done())
        tell("no execute", ActionServer, made, Fibonacci, "other", None)
        tell("name", ActionServer, made, Fibonacci, "a b", _fibonacci)
        tell("client name", ActionClient, made, Fibonacci, "1a")
        client.destroy()
        server.destroy()


def two_servers() -> None:
    """Two servers of one name."""
    with node() as made, spinner(made) as spin:
        calls: list[str] = []

        def execute(name: str) -> Any:
            def callback(goal: Any) -> Any:
                calls.append(name)
                goal.succeed()
                return Fibonacci.Result()

            return callback

        servers = [ActionServer(made, Fibonacci, "action", execute(name)) for name in "ab"]
        client = ActionClient(made, Fibonacci, "action")
        handle = _goal(spin, client)
        spin(seconds=0.2)
        print(handle.accepted, sorted(calls))
        client.destroy()
        for each in servers:
            each.destroy()
