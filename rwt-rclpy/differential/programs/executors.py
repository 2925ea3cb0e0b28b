"""Executors, tasks, futures, callback groups, guard conditions and timers."""

import threading
import time
import warnings
from typing import Any

import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.task import Future
from std_msgs.msg import Int32

from differential.steps import QUIET_S, node, public, spinner, tell, wait


def _raise(error: BaseException) -> Any:
    def callback(*_: Any) -> None:
        raise error

    return callback


def timer_fires() -> None:
    """A timer calls back."""
    with node() as made, spinner(made) as spin:
        calls: list[int] = []
        timer = made.create_timer(0.02, lambda: calls.append(1))
        print(spin(lambda: len(calls) == 3), timer.timer_period_ns, timer.is_canceled())


def timer_cancelled() -> None:
    """Cancel and reset."""
    with node() as made, spinner(made) as spin:
        calls: list[int] = []
        timer = made.create_timer(0.02, lambda: calls.append(1))
        timer.cancel()
        spin(seconds=0.1)
        print(calls, timer.is_canceled(), timer.is_ready(), timer.time_until_next_call())
        timer.reset()
        print(spin(lambda: calls), timer.is_canceled())


def timer_exception() -> None:
    """An exception of a timer ends the spin, and the timer goes on."""
    with node() as made, spinner(made) as spin:
        timer = made.create_timer(0.02, _raise(ZeroDivisionError("timer")))
        tell("first", spin)
        tell("second", spin)
        print(timer.is_canceled())


def timer_destroyed() -> None:
    """A destroyed timer."""
    with node() as made:
        timer = made.create_timer(1, print)
        print(made.destroy_timer(timer), made.destroy_timer(timer))
        for name in (
            "is_ready",
            "cancel",
            "reset",
            "time_until_next_call",
            "is_canceled",
            "time_since_last_call",
        ):
            tell(name, getattr(timer, name))


def timer_arguments() -> None:
    """Periods and callbacks."""
    with node() as made:
        tell("negative", lambda: made.create_timer(-1, print).timer_period_ns)
        tell("zero", lambda: made.create_timer(0, print).timer_period_ns)
        tell("text", lambda: made.create_timer("1", print).timer_period_ns)
        tell("words", lambda: made.create_timer("a", print).timer_period_ns)
        tell("none", lambda: made.create_timer(None, print).timer_period_ns)
        tell("small", lambda: made.create_timer(1e-9, print).timer_period_ns)
        tell("large", lambda: made.create_timer(1e10, print).timer_period_ns)
        tell("no callback", lambda: made.create_timer(1, None).timer_period_ns)
        tell("autostart", lambda: made.create_timer(1, print, autostart=False).is_canceled())


def timer_info() -> None:
    """A callback with a parameter receives the times of the call."""
    from rclpy.timer import TimerInfo

    with node() as made, spinner(made) as spin:
        told: list[Any] = []

        def callback(info: TimerInfo) -> None:
            told.append(info)

        made.create_timer(0.02, callback)
        spin(lambda: told)
        info = told[0]
        print(type(info).__name__, public(info))
        print(type(info.expected_call_time).__name__, info.actual_call_time >= info.expected_call_time)


def timer_after_shutdown() -> None:
    """Timers need a context."""
    with node() as made:
        rclpy.shutdown()
        tell("timer", lambda: made.create_timer(1, print).timer_period_ns)
        tell("publisher", lambda: made.create_publisher(Int32, "topic", 1).topic)
        tell("subscription", lambda: made.create_subscription(Int32, "topic", print, 1).topic)
        tell("guard condition", lambda: bool(made.create_guard_condition(print)))


def timer_attributes() -> None:
    """Public attributes."""
    with node() as made:
        timer = made.create_timer(0.5, print)
        print(public(timer))
        timer.timer_period_ns = 1000
        print(timer.timer_period_ns, timer.callback is print, type(timer.clock).__name__)


def rate_sleeps() -> None:
    """A rate in a thread beside the spin."""
    with node() as made:
        executor = SingleThreadedExecutor()
        executor.add_node(made)
        thread = threading.Thread(target=executor.spin, daemon=True)
        thread.start()
        rate = made.create_rate(20)
        begin = time.monotonic()
        for _ in range(3):
            rate.sleep()
        print(0.08 < time.monotonic() - begin < 1.0)
        made.destroy_rate(rate)
        tell("destroyed", rate.sleep)
        executor.shutdown()
        thread.join(2)


def rate_arguments() -> None:
    """Frequencies."""
    with node() as made:
        for frequency in (0, -1):
            tell(frequency, made.create_rate, frequency)


def guard_condition_triggers() -> None:
    """A guard condition runs its callback."""
    with node() as made, spinner(made) as spin:
        told: list[int] = []
        guard = made.create_guard_condition(lambda: told.append(1))
        guard.trigger()
        guard.trigger()
        spin(lambda: told)
        spin(seconds=0.1)
        print(told, public(guard))
        made.destroy_guard_condition(guard)
        tell("trigger", guard.trigger)


def guard_condition_exception() -> None:
    """An exception of a guard condition's callback."""
    with node() as made, spinner(made) as spin:
        guard = made.create_guard_condition(_raise(ZeroDivisionError("guard")))
        guard.trigger()
        tell("spin", spin, seconds=0.3)


def subscription_exception() -> None:
    """An exception of a subscription's callback."""
    with node() as made, spinner(made) as spin:
        publisher = made.create_publisher(Int32, "topic", 10)
        made.create_subscription(Int32, "topic", _raise(ZeroDivisionError("subscription")), 10)
        spin(lambda: publisher.get_subscription_count())
        publisher.publish(Int32())
        tell("spin", spin)


def system_exit_in_callback() -> None:
    """SystemExit of a timer's callback."""
    with node() as made:
        made.create_timer(0.02, _raise(SystemExit(3)))
        try:
            rclpy.spin_once(made, timeout_sec=2)
        except SystemExit as end:
            print("SystemExit", end.code)
        else:
            print("nothing")


def system_exit_ends_the_program() -> None:
    """A program that ends by SystemExit in a callback."""
    rclpy.init(args=[])
    made = rclpy.create_node("node")
    made.create_timer(0.02, _raise(SystemExit(3)))
    rclpy.spin(made)


def keyboard_interrupt_in_callback() -> None:
    """KeyboardInterrupt of a callback."""
    with node() as made:
        made.create_timer(0.02, _raise(KeyboardInterrupt()))
        try:
            rclpy.spin_once(made, timeout_sec=2)
        except KeyboardInterrupt:
            print("KeyboardInterrupt")
        else:
            print("nothing")


def exception_in_multi_threaded_executor() -> None:
    """An exception of a callback in a pool."""
    with node() as made:
        executor = MultiThreadedExecutor(2)
        executor.add_node(made)
        timer = made.create_timer(0.05, _raise(ZeroDivisionError("timer")))
        tell("spin", executor.spin)
        timer.cancel()
        executor.shutdown()


def exceptions_in_multi_threaded_executor() -> None:
    """Each exception is raised once."""
    with node() as made:
        executor = MultiThreadedExecutor(2)
        executor.add_node(made)
        count = 0
        timer = made.create_timer(0.05, _raise(ZeroDivisionError("timer")))
        end = time.monotonic() + 3
        while count < 2 and time.monotonic() < end:
            try:
                executor.spin_once(timeout_sec=0.1)
            except ZeroDivisionError:
                count += 1
                timer.cancel()
                end = min(end, time.monotonic() + 0.5)
        print(count)
        executor.shutdown()


def spin_until_future_complete() -> None:
    """Spinning ends with the future, or in time."""
    with node() as made:
        future = Future()
        timer = made.create_timer(0.02, lambda: future.set_result(5))
        rclpy.spin_until_future_complete(made, future)
        print(future.result())
        timer.cancel()
        begin = time.monotonic()
        rclpy.spin_until_future_complete(made, Future(), timeout_sec=0.2)
        print(0.15 < time.monotonic() - begin < 1.5)
        rclpy.spin_until_future_complete(made, Future(), timeout_sec=0)


def spin_once_without_work() -> None:
    """Spinning once while no entity is ready."""
    with node() as made:
        tell("spin", rclpy.spin_once, made, timeout_sec=0)
        tell("spin", rclpy.spin_once, made, timeout_sec=0.05)


def spin_after_shutdown() -> None:
    """Spinning needs a context."""
    with node() as made:
        rclpy.shutdown()
        tell("spin", rclpy.spin, made)
        tell("once", rclpy.spin_once, made, timeout_sec=0)
        tell("until", rclpy.spin_until_future_complete, made, Future(), timeout_sec=0)


def shutdown_in_callback() -> None:
    """rclpy.shutdown() in a callback ends the spin."""
    with node() as made:
        made.create_timer(0.02, rclpy.shutdown)
        tell("spin", rclpy.spin, made)
        print(rclpy.ok())


def executor_shutdown_in_callback() -> None:
    """The executor's own shutdown in a callback."""
    with node() as made:
        executor = SingleThreadedExecutor()
        executor.add_node(made)
        made.create_timer(0.02, lambda: executor.shutdown(timeout_sec=0))
        tell("spin", executor.spin)
        print(executor.get_nodes())


def executor_after_shutdown() -> None:
    """An executor that was shut down."""
    with node() as made:
        executor = SingleThreadedExecutor()
        print(executor.shutdown())
        tell("add", executor.add_node, made)
        tell("task", lambda: bool(executor.create_task(print)))
        tell("spin", executor.spin)
        tell("once", executor.spin_once, timeout_sec=0)
        tell("until", executor.spin_until_future_complete, Future(), timeout_sec=0)
        tell("again", executor.shutdown)


def executor_nodes() -> None:
    """Nodes of an executor."""
    with node() as made:
        first, second = SingleThreadedExecutor(), SingleThreadedExecutor()
        print(first.add_node(made), first.add_node(made), made.executor is first)
        print(second.add_node(made), made.executor is second, len(first.get_nodes()), len(second.get_nodes()))
        second.remove_node(made)
        print(made.executor is None, len(second.get_nodes()))
        tell("again", second.remove_node, made)


def executor_attributes() -> None:
    """Public attributes."""
    with node():
        print(public(SingleThreadedExecutor()))
        print(public(MultiThreadedExecutor(2)))


def executor_as_context_manager() -> None:
    """The block shuts it down."""
    with node() as made, SingleThreadedExecutor() as executor:
        executor.add_node(made)
    print(len(executor.get_nodes()))


def single_thread_warning() -> None:
    """A pool of one thread."""
    with node(), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        MultiThreadedExecutor(1)
        print([each.category.__name__ for each in caught])


def tasks_run() -> None:
    """Functions and coroutines as tasks."""
    with node() as made:
        executor = SingleThreadedExecutor()
        executor.add_node(made)

        async def coroutine(value: int) -> int:
            return value + 1

        tasks = [
            executor.create_task(lambda: 1),
            executor.create_task(coroutine, 1),
            executor.create_task(coroutine(2)),
        ]
        for task in tasks:
            executor.spin_until_future_complete(task, timeout_sec=2)
            print(task.done(), task.result())


def tasks_in_order() -> None:
    """The order of tasks."""
    with node() as made:
        executor = SingleThreadedExecutor()
        executor.add_node(made)
        order: list[int] = []
        tasks = [executor.create_task(order.append, number) for number in range(5)]
        for task in tasks:
            executor.spin_until_future_complete(task, timeout_sec=2)
        print(order)


def tasks_that_wait() -> None:
    """A coroutine waits for a future."""
    with node() as made:
        executor = SingleThreadedExecutor()
        executor.add_node(made)
        future = Future()

        async def waits() -> Any:
            return await future

        task = executor.create_task(waits)
        executor.spin_once(timeout_sec=0.1)
        print(task.done())
        future.set_result("now")
        executor.spin_until_future_complete(task, timeout_sec=2)
        print(task.done(), task.result())


def task_exception() -> None:
    """An exception of a task."""
    with node() as made:
        executor = SingleThreadedExecutor()
        executor.add_node(made)
        task = executor.create_task(_raise(ZeroDivisionError("task")))
        tell("spin", executor.spin_until_future_complete, task, timeout_sec=1)
        print(task.done(), repr(task.exception()))


def task_cancelled() -> None:
    """A cancelled task."""
    with node() as made:
        executor = SingleThreadedExecutor()
        executor.add_node(made)
        ran: list[int] = []
        task = executor.create_task(ran.append, 1)
        task.cancel()
        executor.spin_once(timeout_sec=0.1)
        print(ran, task.done(), task.cancelled())


def future_states() -> None:
    """States of a future."""
    future = Future()
    print(future.done(), future.cancelled(), future.result(), future.exception())
    future.set_result(3)
    print(future.done(), future.cancelled(), future.result(), future.exception())
    future.set_result(4)
    print(future.result())
    failed = Future()
    failed.set_exception(ValueError("a"))
    tell("result", failed.result)
    print(repr(failed.exception()), failed.done())
    cancelled = Future()
    cancelled.cancel()
    print(cancelled.cancelled(), cancelled.done(), cancelled.result())
    cancelled.set_result(1)
    print(cancelled.cancelled(), cancelled.done())


def future_callbacks() -> None:
    """Callbacks of a future."""
    told: list[Any] = []
    future = Future()
    future.add_done_callback(lambda f: told.append(f.result()))
    future.set_result(1)
    print(told)
    future.add_done_callback(lambda f: told.append("late"))
    print(told)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        failing = Future()
        failing.add_done_callback(_raise(ValueError("a")))
        tell("set", failing.set_result, 1)
        print([each.category.__name__ for each in caught])


def future_attributes() -> None:
    """Public attributes."""
    print(public(Future()))


def mutually_exclusive_callbacks() -> None:
    """One callback of a group at a time."""
    with node() as made:
        executor = MultiThreadedExecutor(4)
        executor.add_node(made)
        group = MutuallyExclusiveCallbackGroup()
        running: list[int] = []
        most: list[int] = []

        def callback() -> None:
            running.append(1)
            most.append(len(running))
            time.sleep(0.02)
            running.pop()

        for _ in range(3):
            made.create_timer(0.01, callback, callback_group=group)
        end = time.monotonic() + 0.3
        while time.monotonic() < end:
            executor.spin_once(timeout_sec=0.05)
        print(max(most))
        executor.shutdown()


def reentrant_callbacks() -> None:
    """Callbacks of a reentrant group run beside each other."""
    with node() as made:
        executor = MultiThreadedExecutor(4)
        executor.add_node(made)
        group = ReentrantCallbackGroup()
        barrier = threading.Barrier(2, timeout=5)
        met: list[int] = []

        def callback() -> None:
            barrier.wait()
            met.append(1)

        timers = [made.create_timer(0.02, callback, callback_group=group) for _ in range(2)]
        end = time.monotonic() + 5
        while len(met) < 2 and time.monotonic() < end:
            executor.spin_once(timeout_sec=0.05)
        for timer in timers:
            timer.cancel()
        barrier.abort()
        print(len(met) >= 2)
        executor.shutdown()


def groups() -> None:
    """Callback groups."""
    with node() as made:
        group = ReentrantCallbackGroup()
        timer = made.create_timer(1, print, callback_group=group)
        print(group.has_entity(timer), made.default_callback_group.has_entity(timer))
        print(public(group), public(MutuallyExclusiveCallbackGroup()))
        print(group.can_execute(timer), type(made.default_callback_group).__name__)


def coroutine_callback_of_timer() -> None:
    """A coroutine as a timer's callback."""
    with node() as made, spinner(made) as spin:
        told: list[str] = []
        future = Future()

        async def callback() -> None:
            timer.cancel()
            told.append("begin")
            await future
            told.append("end")

        timer = made.create_timer(0.02, callback)
        spin(lambda: told)
        spin(seconds=0.1)
        print(told)
        future.set_result(None)
        spin(lambda: len(told) == 2)
        print(told)


def blocking_spin_in_callback() -> None:
    """Spinning within a callback."""
    with node() as made:

        def callback() -> None:
            timer.cancel()
            tell("inner", rclpy.spin_once, made, timeout_sec=0.05)

        timer = made.create_timer(0.02, callback)
        tell("outer", rclpy.spin_once, made, timeout_sec=2)


def same_executor_in_two_threads() -> None:
    """Two threads that spin one executor."""
    with node() as made:
        executor = SingleThreadedExecutor()
        executor.add_node(made)
        thread = threading.Thread(target=executor.spin, daemon=True)
        thread.start()
        wait(lambda: False, 0.2)
        tell("second", executor.spin_once, timeout_sec=0.1)
        executor.shutdown()
        thread.join(2)


def node_destroyed_while_spinning() -> None:
    """Destroying a node in its own callback."""
    with node() as made:
        other = rclpy.create_node("other")
        executor = SingleThreadedExecutor()
        executor.add_node(other)
        executor.add_node(made)
        told: list[int] = []

        def callback() -> None:
            told.append(1)
            other.destroy_node()

        other.create_timer(0.02, callback)
        end = time.monotonic() + QUIET_S
        while time.monotonic() < end:
            executor.spin_once(timeout_sec=0.05)
        print(told)
        executor.shutdown()


def waitables() -> None:
    """A waitable of the program."""
    from rclpy.waitable import NumberOfEntities, Waitable

    print(public(NumberOfEntities()), NumberOfEntities())
    print(NumberOfEntities(1, 2, 3) + NumberOfEntities(1, 0, 0, 4))
    print(public(Waitable))


def global_executor() -> None:
    """The executor of rclpy.spin."""
    with node():
        print(
            type(rclpy.get_global_executor()).__name__,
            rclpy.get_global_executor() is rclpy.get_global_executor(),
        )


def order_of_ready_entities() -> None:
    """Work that is ready at the same time: timers, subscriptions, guard conditions, clients, services."""
    from std_srvs.srv import Empty

    with node() as made:
        told: list[str] = []
        guard = made.create_guard_condition(lambda: told.append("guard condition"))

        def answer(request: Any, response: Any) -> Any:
            told.append("service")
            return response

        made.create_service(Empty, "service", answer)
        client = made.create_client(Empty, "service")
        made.create_subscription(Int32, "topic", lambda message: told.append("subscription"), 10)
        publisher = made.create_publisher(Int32, "topic", 10)
        client.wait_for_service(5)
        wait(publisher.get_subscription_count)
        made.create_timer(0.01, lambda: told.append("timer")).reset()
        client.call_async(Empty.Request()).add_done_callback(lambda future: told.append("client"))
        publisher.publish(Int32())
        guard.trigger()
        time.sleep(0.3)
        executor = SingleThreadedExecutor()
        executor.add_node(made)
        for _ in range(4):
            executor.spin_once(timeout_sec=0)
        print(told)
        executor.shutdown()


def timer_in_its_own_callback() -> None:
    """A timer that is cancelled, changed or destroyed by its own callback."""
    with node() as made, spinner(made) as spin:
        calls: list[str] = []

        def cancel() -> None:
            calls.append("cancel")
            cancelled.cancel()

        def destroy() -> None:
            calls.append("destroy")
            made.destroy_timer(destroyed)

        def change() -> None:
            calls.append("change")
            changed.timer_period_ns = 10**12

        cancelled = made.create_timer(0.02, cancel)
        destroyed = made.create_timer(0.03, destroy)
        changed = made.create_timer(0.04, change)
        spin(seconds=0.4)
        print(sorted(calls), cancelled.is_canceled(), len(list(made.timers)))


def timers_made_in_callbacks() -> None:
    """Entities that callbacks make are served at once."""
    with node() as made, spinner(made) as spin:
        told: list[str] = []

        def first() -> None:
            timer.cancel()
            made.create_timer(0.01, second)

        def second() -> None:
            if not told:
                told.append("second")
                made.create_subscription(Int32, "topic", lambda message: told.append("received"), 10)

        timer = made.create_timer(0.01, first)
        publisher = made.create_publisher(Int32, "topic", 10)
        spin(lambda: publisher.get_subscription_count())
        publisher.publish(Int32())
        print(spin(lambda: "received" in told), told)


def late_timer() -> None:
    """A timer that missed periods calls back once."""
    with node() as made:
        calls: list[int] = []
        timer = made.create_timer(0.05, lambda: calls.append(1))
        executor = SingleThreadedExecutor()
        executor.add_node(made)
        time.sleep(0.32)
        print(timer.is_ready(), timer.time_until_next_call() <= 0)
        executor.spin_once(timeout_sec=0)
        executor.spin_once(timeout_sec=0)
        print(len(calls), timer.is_ready(), 0 < timer.time_until_next_call() <= 50_000_000)
        executor.shutdown()


def groups_of_one_node() -> None:
    """Several groups beside each other: how many callbacks run at once."""
    with node() as made:
        most: dict[str, int] = {}
        now: dict[str, int] = {}
        lock = threading.Lock()

        def busy(name: str) -> Any:
            def callback() -> None:
                with lock:
                    now[name] = now.get(name, 0) + 1
                    most[name] = max(most.get(name, 0), now[name])
                    most["all"] = max(most.get("all", 0), sum(now.values()))
                time.sleep(0.1)
                with lock:
                    now[name] -= 1

            return callback

        exclusive, reentrant = MutuallyExclusiveCallbackGroup(), ReentrantCallbackGroup()
        for name, group in (("exclusive", exclusive), ("reentrant", reentrant), ("default", None)):
            for _ in range(2):
                made.create_timer(0.02, busy(name), callback_group=group)
        executor = MultiThreadedExecutor(8)
        executor.add_node(made)
        thread = threading.Thread(target=executor.spin)
        thread.start()
        time.sleep(1)
        executor.shutdown()
        thread.join()
        print(most["exclusive"], most["default"], most["reentrant"] >= 2, most["all"] >= 4)


def call_in_a_callback() -> None:
    """A blocking call in a callback: with a group of its own, and in the same group."""
    from std_srvs.srv import Empty

    def called(own: bool) -> None:
        with node() as made:
            told: list[str] = []
            client = made.create_client(
                Empty, "service", callback_group=MutuallyExclusiveCallbackGroup() if own else None
            )
            made.create_service(
                Empty, "service", lambda request, response: response, callback_group=ReentrantCallbackGroup()
            )

            def callback() -> None:
                timer.cancel()
                future = client.call_async(Empty.Request())
                done = threading.Event()
                future.add_done_callback(lambda future: done.set())
                told.append(f"answered {done.wait(0.5)}")

            client.wait_for_service(5)
            timer = made.create_timer(0.05, callback)
            executor = MultiThreadedExecutor(4)
            executor.add_node(made)
            thread = threading.Thread(target=executor.spin)
            thread.start()
            wait(lambda: told)
            print(own, told)
            executor.shutdown()
            thread.join()

    called(True)
    called(False)


def coroutine_callbacks() -> None:
    """Subscriptions and services with coroutines that await a service."""
    from std_srvs.srv import SetBool

    with node() as made, spinner(made) as spin:
        told: list[Any] = []
        group = ReentrantCallbackGroup()
        client = made.create_client(SetBool, "inner", callback_group=group)

        async def outer(request: Any, response: Any) -> Any:
            answer = await client.call_async(SetBool.Request(data=request.data))
            response.success, response.message = answer.success, f"outer {answer.message}"
            return response

        async def received(message: Int32) -> None:
            told.append(message.data)
            answer = await client.call_async(SetBool.Request(data=bool(message.data)))
            told.append(answer.message)

        def inner(request: Any, response: Any) -> Any:
            response.success, response.message = request.data, f"inner {request.data}"
            return response

        made.create_service(SetBool, "inner", inner, callback_group=group)
        made.create_service(SetBool, "outer", outer, callback_group=group)
        made.create_subscription(Int32, "topic", received, 10, callback_group=group)
        other = made.create_client(SetBool, "outer")
        publisher = made.create_publisher(Int32, "topic", 10)
        other.wait_for_service(5)
        client.wait_for_service(5)
        spin(publisher.get_subscription_count)
        future = other.call_async(SetBool.Request(data=True))
        spin(future.done)
        print(future.result())
        publisher.publish(Int32(data=3))
        spin(lambda: len(told) == 2)
        print(told)


def tasks_with_arguments() -> None:
    """Functions and coroutines with arguments, results and callbacks."""
    with node() as made:
        executor = SingleThreadedExecutor()
        executor.add_node(made)
        told: list[Any] = []

        async def coroutine(a: int, *, b: int) -> int:
            return a * b

        plain = executor.create_task(lambda a, b=0: a + b, 1, b=2)
        awaited = executor.create_task(coroutine, 3, b=4)
        running = executor.create_task(coroutine(5, b=6))
        for each in (plain, awaited, running):
            each.add_done_callback(lambda task: told.append(task.result()))
            print(each.done(), each.executing(), each.cancelled(), each.result())
        for _ in range(10):
            executor.spin_once(timeout_sec=0)
        print(plain.result(), awaited.result(), running.result(), sorted(told))
        tell("again", plain)
        print(type(plain).__name__, bool(plain), plain.exception())
        executor.shutdown()


def await_a_task() -> None:
    """A coroutine that awaits another task, a future, and one that fails."""
    with node() as made:
        executor = SingleThreadedExecutor()
        executor.add_node(made)
        future = Future(executor=executor)

        async def failing() -> None:
            raise ZeroDivisionError("inner")

        async def outer() -> list[Any]:
            told: list[Any] = [await future]
            try:
                await executor.create_task(failing)
            except ZeroDivisionError as error:
                told.append(str(error))
            return told

        task = executor.create_task(outer)
        for _ in range(5):
            executor.spin_once(timeout_sec=0)
        print(task.done())
        future.set_result("value")
        raised = []
        for _ in range(10):
            try:
                executor.spin_once(timeout_sec=0)
            except ZeroDivisionError as error:
                raised.append(str(error))
        print(
            raised, task.done(), task.result() if task.done() and not task.exception() else task.exception()
        )
        executor.shutdown()


def await_in_asyncio() -> None:
    """A future of rclpy that a coroutine of asyncio awaits."""
    import asyncio

    with node() as made:
        future: Any = Future()
        made.create_timer(0.05, lambda: future.set_result("done"))

        async def spin() -> None:
            while not future.done():
                rclpy.spin_once(made, timeout_sec=0)
                await asyncio.sleep(0)

        async def both() -> Any:
            spinning = asyncio.ensure_future(spin())
            result = await future
            await spinning
            return result

        print(asyncio.run(both()))


def node_of_two_executors() -> None:
    """A node that is added to a second executor, removed, and added again."""
    with node() as made:
        first, second = SingleThreadedExecutor(), MultiThreadedExecutor(2)
        print(first.add_node(made), made.executor is first)
        print(second.add_node(made), made.executor is second, len(first.get_nodes()), len(second.get_nodes()))
        print(second.add_node(made), len(second.get_nodes()))
        second.remove_node(made)
        print(made.executor, len(second.get_nodes()))
        tell("remove again", second.remove_node, made)
        print(first.add_node(made), made.executor is first)
        made.executor = None
        print(made.executor, len(first.get_nodes()))
        first.shutdown()
        second.shutdown()


def numbers_of_threads() -> None:
    """Arguments of the multi-threaded executor."""
    with node():
        for threads in (None, 1, 2, 0, -1, "2", 1.5):
            executor = tell(threads, lambda t=threads: type(MultiThreadedExecutor(t)).__name__)
            print(executor)


def spin_once_until_future_complete() -> None:
    """Spinning until a future of a timer, with and without a time-out."""
    with node() as made:
        executor = SingleThreadedExecutor()
        executor.add_node(made)
        future: Any = Future()
        calls: list[int] = []

        def callback() -> None:
            calls.append(1)
            if len(calls) == 2:
                future.set_result(len(calls))

        made.create_timer(0.05, callback)
        executor.spin_once_until_future_complete(future, timeout_sec=0.01)
        print(future.done(), calls)
        executor.spin_until_future_complete(future, timeout_sec=2)
        print(future.result(), len(calls))
        tell("done", executor.spin_until_future_complete, future)
        tell("text", executor.spin_until_future_complete, Future(), timeout_sec="1")
        tell("negative timeout of a done future", executor.spin_until_future_complete, future, timeout_sec=-1)
        executor.shutdown()


def functions_of_the_module() -> None:
    """`rclpy.spin_once` and others with the global executor and an executor of one's own."""
    with node() as made:
        calls: list[int] = []
        made.create_timer(0.01, lambda: calls.append(1))
        rclpy.spin_once(made, timeout_sec=1)
        print(len(calls), made.executor)
        executor = SingleThreadedExecutor()
        rclpy.spin_once(made, executor=executor, timeout_sec=1)
        print(len(calls), made.executor, len(executor.get_nodes()))
        executor.add_node(made)
        rclpy.spin_once(made, timeout_sec=0.1)
        print(made.executor is executor, made.executor is None)
        future: Any = Future()
        rclpy.spin_until_future_complete(made, future, executor, 0.1)
        print(future.done(), made.executor is executor, len(executor.get_nodes()))
        executor.shutdown()


def future_errors() -> None:
    """Results that are set twice, exceptions, and cancelled futures."""
    future: Any = Future()
    future.set_result(1)
    tell("again", future.set_result, 2)
    tell("exception after result", future.set_exception, ValueError())
    print(future.result() if not future.exception() else repr(future.exception()))
    tell("cancel", future.cancel)
    print(future.cancelled(), future.done())
    other: Any = Future()
    other.set_exception(ZeroDivisionError("wrong"))
    tell("result", other.result)
    print(repr(other.exception()), other.done())
    third: Any = Future()
    third.cancel()
    print(third.cancelled(), third.done(), third.result())
    tell("set", third.set_result, 1)
    print(third.done(), third.result())
    tell("not an exception", Future().set_exception, "text")
    tell("await", lambda: next(iter(Future().__await__())))


def callbacks_after_removal() -> None:
    """A node that is removed while it has work."""
    with node() as made:
        executor = SingleThreadedExecutor()
        executor.add_node(made)
        calls: list[int] = []
        made.create_timer(0.01, lambda: calls.append(1))
        executor.spin_once(timeout_sec=1)
        executor.remove_node(made)
        time.sleep(0.05)
        executor.spin_once(timeout_sec=0.1)
        print(len(calls), made.executor)
        executor.add_node(made)
        executor.spin_once(timeout_sec=1)
        print(len(calls))
        executor.shutdown()


def subscription_destroyed_with_messages() -> None:
    """A subscription that is destroyed in its own callback."""
    with node() as made, spinner(made) as spin:
        received: list[int] = []

        def callback(message: Int32) -> None:
            received.append(message.data)
            print(made.destroy_subscription(subscription))

        subscription = made.create_subscription(Int32, "topic", callback, 10)
        publisher = made.create_publisher(Int32, "topic", 10)
        spin(publisher.get_subscription_count)
        for number in range(3):
            publisher.publish(Int32(data=number))
        spin(seconds=0.3)
        print(received, len(list(made.subscriptions)), publisher.get_subscription_count())
