"""Services and clients."""

import threading
from typing import Any

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from std_srvs.srv import Empty, SetBool, Trigger

from differential.steps import QUIET_S, node, public, spinner, tell, wait, with_logs


def _answer(request: Any, response: Any) -> Any:
    response.success = request.data
    response.message = "done"
    return response


def call_async() -> None:
    """A response through a future."""
    with node() as made, spinner(made) as spin:
        made.create_service(SetBool, "service", _answer)
        client = made.create_client(SetBool, "service")
        print(client.wait_for_service(5))
        future = client.call_async(SetBool.Request(data=True))
        print(spin(future.done), future.result())


def call_blocking() -> None:
    """A blocking call beside a spinning thread."""
    with node() as made:
        made.create_service(SetBool, "service", _answer)
        client = made.create_client(SetBool, "service")
        client.wait_for_service(5)
        executor = MultiThreadedExecutor(2)
        executor.add_node(made)
        thread = threading.Thread(target=executor.spin)
        thread.start()
        print(client.call(SetBool.Request(data=False)))
        executor.shutdown()
        thread.join()


def call_times_out() -> None:
    """A blocking call without a server."""
    with node() as made:
        client = made.create_client(SetBool, "service")
        tell("call", client.call, SetBool.Request(), timeout_sec=0.2)


def call_of_wrong_type() -> None:
    """Requests of another class."""
    with node() as made:
        client = made.create_client(SetBool, "service")
        tell("response", client.call_async, SetBool.Response())
        tell("none", client.call_async, None)
        tell("blocking", client.call, Trigger.Request())


def call_unavailable() -> None:
    """A call without a service is pending."""
    with node() as made, spinner(made) as spin:
        client = made.create_client(SetBool, "service")
        print(client.service_is_ready(), client.wait_for_service(0.1))
        future = client.call_async(SetBool.Request())
        spin(seconds=QUIET_S)
        print(future.done(), future.result(), future.exception())


@with_logs
def call_unavailable_logs() -> None:
    """A call without a service logs nothing."""
    with node() as made, spinner(made) as spin:
        made.create_client(SetBool, "service").call_async(SetBool.Request())
        spin(seconds=QUIET_S)


def call_before_the_service_exists() -> None:
    """A request that was sent before the service existed."""
    with node() as made, spinner(made) as spin:
        client = made.create_client(SetBool, "service")
        future = client.call_async(SetBool.Request())
        made.create_service(SetBool, "service", _answer)
        spin(seconds=QUIET_S)
        print(future.done())


def two_servers() -> None:
    """Two services with one name in two nodes."""
    with node("a") as first:
        second = rclpy.create_node("b")
        called: list[str] = []

        def server(name: str) -> Any:
            def answer(request: Any, response: Any) -> Any:
                called.append(name)
                return _answer(request, response)

            return answer

        first.create_service(SetBool, "/service", server("first"))
        second.create_service(SetBool, "/service", server("second"))
        client = first.create_client(SetBool, "/service")
        client.wait_for_service(5)
        wait(lambda: first.count_services("/service") == 2)
        print(first.count_services("/service"))
        with spinner(first, second) as spin:
            future = client.call_async(SetBool.Request(data=True))
            spin(future.done)
            spin(lambda: len(called) == 2, 2)
        print(future.result(), sorted(called))


@with_logs
def two_nodes_of_one_name() -> None:
    """Two nodes with one name: all their services exist."""
    with node("same") as first:
        second = rclpy.create_node("same")
        wait(lambda: first.count_services("/same/get_parameters") == 2)
        print(first.count_services("/same/get_parameters"))
        second.destroy_node()
        wait(lambda: first.count_services("/same/get_parameters") == 1)
        print(first.count_services("/same/get_parameters"))


def two_servers_one_destroyed() -> None:
    """The other service remains."""
    with node() as made, spinner(made) as spin:
        made.create_service(SetBool, "service", lambda q, r: SetBool.Response(message="first"))
        second = made.create_service(SetBool, "service", lambda q, r: SetBool.Response(message="second"))
        made.destroy_service(second)
        client = made.create_client(SetBool, "service")
        client.wait_for_service(5)
        wait(lambda: made.count_services("service") == 1)
        future = client.call_async(SetBool.Request())
        spin(future.done)
        print(future.result().message)


def callback_raises() -> None:
    """An exception of a callback ends the spin; the caller gets no response."""
    with node() as made, spinner(made) as spin:

        def fail(request: Any, response: Any) -> Any:
            raise ValueError("no")

        made.create_service(SetBool, "service", fail)
        client = made.create_client(SetBool, "service")
        client.wait_for_service(5)
        future = client.call_async(SetBool.Request())
        tell("spin", spin, future.done)
        spin(future.done, QUIET_S)
        print(future.done())


def _client_of_failing(made: Any) -> tuple[Any, list[bool]]:
    """Return a client of a service that fails on the first call, and the requests of all calls."""
    calls: list[bool] = []

    def fail_once(request: Any, response: Any) -> Any:
        calls.append(request.data)
        if len(calls) == 1:
            raise ValueError("no")
        return _answer(request, response)

    made.create_service(SetBool, "service", fail_once)
    client = made.create_client(SetBool, "service")
    client.wait_for_service(5)
    return client, calls


def callback_raises_then_answers() -> None:
    """Answers after an exception of the callback."""
    with node() as made, spinner(made) as spin:
        client, calls = _client_of_failing(made)
        first = client.call_async(SetBool.Request())
        tell("spin", spin, first.done)
        second = client.call_async(SetBool.Request(data=True))
        spin(second.done, 1.0)
        print(calls, first.done(), second.done())


def callback_raises_new_executor() -> None:
    """Answers after an exception of the callback, with rclpy.spin again."""
    with node() as made:
        client, calls = _client_of_failing(made)
        first = client.call_async(SetBool.Request())
        tell("spin", rclpy.spin_until_future_complete, made, first, timeout_sec=2)
        second = client.call_async(SetBool.Request(data=True))
        rclpy.spin_until_future_complete(made, second, timeout_sec=1)
        print(calls, second.done())


def callback_returns_nothing() -> None:
    """A callback that forgets the response."""
    with node() as made, spinner(made) as spin:
        made.create_service(SetBool, "service", lambda q, r: None)
        client = made.create_client(SetBool, "service")
        client.wait_for_service(5)
        future = client.call_async(SetBool.Request())
        tell("spin", spin, future.done)
        print(future.done())


def callback_returns_wrong_type() -> None:
    """A callback that returns another class."""
    with node() as made, spinner(made) as spin:
        made.create_service(SetBool, "service", lambda q, r: Trigger.Response())
        client = made.create_client(SetBool, "service")
        client.wait_for_service(5)
        tell("spin", spin, client.call_async(SetBool.Request()).done)


def coroutine_callback() -> None:
    """A callback may be a coroutine."""
    with node() as made, spinner(made) as spin:

        async def answer(request: Any, response: Any) -> Any:
            return _answer(request, response)

        made.create_service(SetBool, "service", answer)
        client = made.create_client(SetBool, "service")
        client.wait_for_service(5)
        future = client.call_async(SetBool.Request(data=True))
        spin(future.done)
        print(future.result())


def nested_call() -> None:
    """A service that awaits another one."""
    with node() as made, spinner(made) as spin:
        group = ReentrantCallbackGroup()
        inner = made.create_client(SetBool, "inner", callback_group=group)
        made.create_service(SetBool, "inner", _answer, callback_group=group)

        async def outer(request: Any, response: Any) -> Any:
            result = await inner.call_async(SetBool.Request(data=True))
            response.success = result.success
            response.message = "outer"
            return response

        made.create_service(Trigger, "outer", outer, callback_group=group)
        client = made.create_client(Trigger, "outer", callback_group=group)
        client.wait_for_service(5)
        inner.wait_for_service(5)
        future = client.call_async(Trigger.Request())
        spin(future.done)
        print(future.result())


def names() -> None:
    """Names of both ends."""
    with node(namespace="/ns", args=["--ros-args", "-r", "service:=other"]) as made:
        service = made.create_service(Empty, "service", lambda q, r: r)
        client = made.create_client(Empty, "service")
        print(service.srv_name, service.service_name, client.srv_name, client.service_name)
        private = made.create_client(Empty, "~/private")
        print(private.srv_name, private.service_name)
        print(made.resolve_service_name("service"))


def attributes_of_service() -> None:
    """Public attributes."""
    with node() as made:
        print(public(made.create_service(Empty, "service", lambda q, r: r)))


def attributes_of_client() -> None:
    """Public attributes."""
    with node() as made:
        print(public(made.create_client(Empty, "service")))


def destroyed() -> None:
    """Destroyed ends."""
    with node() as made:
        service = made.create_service(Empty, "service", lambda q, r: r)
        client = made.create_client(Empty, "service")
        print(made.destroy_client(client), made.destroy_service(service))
        tell("call", client.call_async, Empty.Request())
        tell("ready", client.service_is_ready)
        tell("name", lambda: service.service_name)
        print(made.destroy_client(client), made.destroy_service(service))


def pending_requests() -> None:
    """Requests can be given up."""
    with node() as made, spinner(made) as spin:
        made.create_service(SetBool, "service", _answer)
        client = made.create_client(SetBool, "service")
        client.wait_for_service(5)
        future = client.call_async(SetBool.Request())
        client.remove_pending_request(future)
        spin(future.done, QUIET_S)
        print(future.done())
        tell("get", client.get_pending_request, 1000)


def cancel_future() -> None:
    """A cancelled request."""
    with node() as made, spinner(made) as spin:
        made.create_service(SetBool, "service", _answer)
        client = made.create_client(SetBool, "service")
        client.wait_for_service(5)
        future = client.call_async(SetBool.Request())
        future.cancel()
        spin(future.done, QUIET_S)
        print(future.cancelled(), future.done())


def many_calls() -> None:
    """Responses belong to their requests."""
    with node() as made, spinner(made) as spin:
        made.create_service(SetBool, "service", _answer)
        client = made.create_client(SetBool, "service")
        client.wait_for_service(5)
        futures = [client.call_async(SetBool.Request(data=bool(i % 2))) for i in range(8)]
        spin(lambda: all(each.done() for each in futures))
        print([each.result().success for each in futures])


def done_callbacks() -> None:
    """Callbacks of the future."""
    with node() as made, spinner(made) as spin:
        told: list[Any] = []
        made.create_service(SetBool, "service", _answer)
        client = made.create_client(SetBool, "service")
        client.wait_for_service(5)
        client.call_async(SetBool.Request(data=True)).add_done_callback(
            lambda f: told.append(f.result().success)
        )
        spin(lambda: told)
        print(told)


def wait_for_service_that_comes() -> None:
    """Waiting ends when the service is there."""
    with node() as made:
        client = made.create_client(SetBool, "service")
        timer = threading.Timer(0.2, lambda: made.create_service(SetBool, "service", _answer))
        timer.start()
        print(client.wait_for_service(5))
        timer.join()


def wrong_types() -> None:
    """Types that are no services."""
    from std_msgs.msg import String

    with node() as made:
        tell("message", lambda: made.create_client(String, "service"))
        tell("request", lambda: made.create_client(SetBool.Request, "service"))
        tell("none", lambda: made.create_service(None, "service", _answer))


def introspection() -> None:
    """Service events."""
    from rclpy.qos import qos_profile_system_default
    from rclpy.service_introspection import ServiceIntrospectionState

    with node() as made, spinner(made) as spin:
        events: list[Any] = []
        service = made.create_service(SetBool, "service", _answer)
        client = made.create_client(SetBool, "service")
        made.create_subscription(SetBool.Event, "service/_service_event", events.append, 10)
        for end in (service, client):
            end.configure_introspection(
                made.get_clock(), qos_profile_system_default, ServiceIntrospectionState.CONTENTS
            )
        client.wait_for_service(5)
        spin(seconds=0.3)
        future = client.call_async(SetBool.Request(data=True))
        spin(future.done)
        spin(lambda: len(events) == 4, 2)
        for event in sorted(events, key=lambda e: e.info.event_type):
            print(
                event.info.event_type, len(event.request), len(event.response), event.info.sequence_number > 0
            )


def service_classes() -> None:
    """Classes of a service."""
    print(public(SetBool), SetBool.Request.__name__, SetBool.Response.__name__, SetBool.Event.__name__)
    print(SetBool.Request(), SetBool.Response(success=True, message="a"))
    tell("instance", SetBool)
