"""Programs like rclpy's examples: actions, callback groups, executors, guard conditions and tasks."""

import threading
import time
from collections import deque
from typing import Any

import rclpy
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.executors import Executor, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time
from rclpy.utilities import remove_ros_args
from std_msgs.msg import String
from std_srvs.srv import Trigger
from test_msgs.action import Fibonacci

from differential.steps import fails, node, spinner, wait, with_logs

_STATUS = {value: name for name, value in vars(GoalStatus).items() if name.startswith("STATUS_")}


def _climb(goal: Any, until: int | None = None) -> Any:
    """Send numbers as feedback until the order, or until a cancellation."""
    numbers = [0, 1]
    for _ in range(until or goal.request.order):
        if goal.is_cancel_requested:
            goal.canceled()
            return Fibonacci.Result(sequence=numbers)
        numbers.append(numbers[-1] + numbers[-2])
        goal.publish_feedback(Fibonacci.Feedback(sequence=numbers))
        time.sleep(0.02)
    goal.succeed()
    return Fibonacci.Result(sequence=numbers)


def action_by_callbacks() -> None:
    """Goal, feedback and result, each in a callback."""
    with node() as made, spinner(made) as spin:
        server = ActionServer(made, Fibonacci, "climb", _climb)
        client = ActionClient(made, Fibonacci, "climb")
        print(client.wait_for_server(timeout_sec=4.0), client.server_is_ready())
        got: dict[str, Any] = {"feedback": []}

        def accepted(future: Any) -> None:
            got["accepted"] = future.result().accepted
            future.result().get_result_async().add_done_callback(
                lambda done: got.update(result=done.result())
            )

        future = client.send_goal_async(
            Fibonacci.Goal(order=3),
            feedback_callback=lambda each: got["feedback"].append(each.feedback.sequence),
        )
        future.add_done_callback(accepted)
        print(spin(lambda: "result" in got), got["accepted"], _STATUS[got["result"].status])
        print(got["result"].result, [list(each) for each in got["feedback"]])
        client.destroy()
        server.destroy()


def action_that_is_cancelled() -> None:
    """A cancellation in the middle, with two threads."""
    with node() as made, spinner(made, executor=MultiThreadedExecutor(3)) as spin:
        server = ActionServer(
            made, Fibonacci, "climb", _climb, callback_group=ReentrantCallbackGroup(),
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip
        client = ActionClient(made, Fibonacci, "climb")
        client.wait_for_server(4)
        sent = client.send_goal_async(Fibonacci.Goal(order=200))
        spin(sent.done)
        handle = sent.result()
        cancelled = handle.cancel_goal_async()
        spin(cancelled.done)
        answer = cancelled.result()
        print(answer.return_code, [each.goal_id == handle.goal_id for each in answer.goals_canceling])
        result = handle.get_result_async()
        print(spin(result.done), _STATUS[result.result().status], handle.status)
        client.destroy()
        server.destroy()


def action_with_a_choosy_server() -> None:
    """Goals that are rejected, aborted, and raise."""

    def choose(request: Any) -> GoalResponse:
        return GoalResponse.REJECT if request.order > 9 else GoalResponse.ACCEPT

    def execute(goal: Any) -> Any:
        if goal.request.order == 1:
            goal.abort()
        if goal.request.order == 2:
            raise ValueError("two")
        return Fibonacci.Result(sequence=[goal.request.order])

    with node() as made, spinner(made) as spin:
        server = ActionServer(made, Fibonacci, "climb", execute, goal_callback=choose)
        client = ActionClient(made, Fibonacci, "climb")
        client.wait_for_server(4)
        for order in (10, 1, 2, 3):
            sent = client.send_goal_async(Fibonacci.Goal(order=order))
            spin(sent.done)
            if not sent.result().accepted:
                print(order, "rejected")
                continue
            result = sent.result().get_result_async()
            spin(result.done)
            print(order, _STATUS[result.result().status], result.result().result)
        fails("goal", client.send_goal_async, Fibonacci.Result())
        client.destroy()
        server.destroy()


def action_with_a_queue() -> None:
    """Deferred goals are executed one after the other."""
    queue: deque[Any] = deque()
    order: list[object] = []

    def next_one() -> None:
        if queue:
            queue.popleft().execute()

    def execute(goal: Any) -> Any:
        order.append(goal.request.order)
        goal.succeed()
        next_one()
        return Fibonacci.Result()

    with node() as made, spinner(made) as spin:
        server = ActionServer(made, Fibonacci, "climb", execute, handle_accepted_callback=queue.append)
        client = ActionClient(made, Fibonacci, "climb")
        client.wait_for_server(4)
        sent = [client.send_goal_async(Fibonacci.Goal(order=each)) for each in (5, 6, 7)]
        spin(lambda: all(each.done() for each in sent))
        spin(lambda: all(each.result().status for each in sent))
        print([each.result().status for each in sent], len(queue))
        next_one()
        results = [each.result().get_result_async() for each in sent]
        print(spin(lambda: all(each.done() for each in results)), order)
        print([_STATUS[each.result().status] for each in results])
        client.destroy()
        server.destroy()


def action_by_wrong_steps() -> None:
    """Transitions of goals that are not allowed."""

    def execute(goal: Any) -> Any:
        goal.succeed()
        fails("again", goal.succeed)
        fails("abort", goal.abort)
        fails("cancelled", goal.canceled)
        fails("feedback", goal.publish_feedback, Fibonacci.Result())
        fails("execute", goal.execute)
        print(goal.is_active, goal.is_cancel_requested, goal.status == GoalStatus.STATUS_SUCCEEDED)
        return Fibonacci.Result()

    with node() as made, spinner(made) as spin:
        server = ActionServer(made, Fibonacci, "climb", execute)
        client = ActionClient(made, Fibonacci, "climb")
        client.wait_for_server(4)
        sent = client.send_goal_async(Fibonacci.Goal(order=1))
        spin(sent.done)
        result = sent.result().get_result_async()
        spin(result.done)
        print(_STATUS[result.result().status])
        fails("no server", lambda: ActionServer(made, Fibonacci, "other", "not callable"))
        fails("name", lambda: ActionClient(made, Fibonacci, "a name"))
        client.destroy()
        server.destroy()


def groups_of_callbacks() -> None:
    """Callbacks of one group never overlap; those of a reentrant one do."""
    with node() as made:
        inside, most = {"one": 0, "many": 0}, {"one": 0, "many": 0}
        lock = threading.Lock()

        def work(name: str) -> None:
            with lock:
                inside[name] += 1
                most[name] = max(most[name], inside[name])
            time.sleep(0.05)
            with lock:
                inside[name] -= 1

        one, many = MutuallyExclusiveCallbackGroup(), ReentrantCallbackGroup()
        for _ in range(2):
            made.create_timer(0.01, lambda: work("one"), callback_group=one)
            made.create_timer(0.01, lambda: work("many"), callback_group=many)
        executor = MultiThreadedExecutor(num_threads=5)
        with spinner(made, executor=executor) as spin:
            spin(lambda: most["many"] > 1)
            spin(seconds=0.2)
        print(most["one"], most["many"] > 1)


def call_inside_a_callback() -> None:
    """A coroutine of a timer awaits a service of the same node."""
    with node() as made, spinner(made) as spin:
        group = ReentrantCallbackGroup()
        made.create_service(Trigger, "ask", lambda _, answer: _answered(answer), callback_group=group)
        client = made.create_client(Trigger, "ask", callback_group=group)
        answers: list[object] = []

        async def ask() -> None:
            timer.cancel()
            answers.append(await client.call_async(Trigger.Request()))

        client.wait_for_service(4)
        timer = made.create_timer(0.01, ask, callback_group=group)
        print(spin(lambda: answers), answers)


def _answered(answer: Any) -> Any:
    answer.success, answer.message = True, "yes"
    return answer


def composed_nodes() -> None:
    """Two nodes in one executor, which one of them leaves."""
    rclpy.init()
    talker, listener = Node("talker"), Node("listener")
    heard: list[str] = []
    publisher = talker.create_publisher(String, "talk", 10)
    talker.create_timer(0.02, lambda: publisher.publish(String(data="hi")))
    listener.create_subscription(String, "talk", lambda m: heard.append(m.data), 10)
    executor = SingleThreadedExecutor()
    print(executor.add_node(talker), executor.add_node(listener), executor.add_node(talker))
    end = time.monotonic() + 4
    while not heard and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.1)
    print(heard[:1], sorted(each.get_name() for each in executor.get_nodes()))
    executor.remove_node(listener)
    count = len(heard)
    for _ in range(5):
        executor.spin_once(timeout_sec=0.03)
    print(len(heard) == count, listener.executor, talker.executor is executor)
    print(executor.shutdown())
    fails("after", executor.spin_once, timeout_sec=0)
    fails("task", executor.create_task, print, "never")
    talker.destroy_node()
    listener.destroy_node()
    rclpy.shutdown()


def executor_of_its_own() -> None:
    """An executor that prefers one node."""

    class _First(Executor):
        def spin_once(self, timeout_sec: float | None = None) -> None:
            handler, _, owner = self.wait_for_ready_callbacks(timeout_sec=timeout_sec)
            names.append(owner.get_name())
            handler()
            if handler.exception() is not None:
                raise handler.exception()

    names: list[str] = []
    rclpy.init()
    first, second = Node("first"), Node("second")

    def broken() -> None:
        raise KeyError("broken")

    first.create_timer(0.02, lambda: None)
    executor = _First()
    executor.add_node(first)
    executor.add_node(second)
    executor.spin_once(timeout_sec=2)
    executor.spin_once(timeout_sec=2)
    second.create_timer(0.0, broken)
    for _ in range(3):
        fails("once", executor.spin_once, timeout_sec=2)
    print(sorted(set(names)))
    executor.shutdown()
    first.destroy_node()
    second.destroy_node()
    rclpy.shutdown()


def guard_that_is_triggered() -> None:
    """A guard condition of a timer."""
    with node() as made, spinner(made) as spin:
        triggered: list[int] = []
        guard = made.create_guard_condition(lambda: triggered.append(1))
        made.create_timer(0.01, guard.trigger)
        print(spin(lambda: len(triggered) > 2), [*made.guards] == [guard])
        print(made.destroy_guard_condition(guard), [*made.guards])
        fails("destroyed", guard.trigger)


def tasks_and_futures() -> None:
    """Tasks with results, exceptions and callbacks."""
    with node() as made:
        executor = SingleThreadedExecutor()
        executor.add_node(made)

        async def twice(value: int) -> int:
            return value * 2

        def broken() -> None:
            raise LookupError("lost")

        done: list[object] = []
        one, two, three = (
            executor.create_task(twice, 4),
            executor.create_task(broken),
            executor.create_task(len, "ab"),
        )
        one.add_done_callback(lambda each: done.append(each.result()))
        for each in (one, three):
            executor.spin_until_future_complete(each, timeout_sec=2)
        fails("broken", executor.spin_until_future_complete, two, 2)
        executor.spin_once(timeout_sec=0)
        print(one.result(), three.result(), repr(two.exception()), done)
        fails("result", two.result)
        future: Future = Future(executor=executor)
        future.cancel()
        print(future.cancelled(), future.done(), bool(future))
        fails("cancelled", future.result)
        executor.spin_until_future_complete(Future(executor=executor), timeout_sec=0.05)
        executor.shutdown()


@with_logs
def managed_node() -> None:
    """A life cycle with a callback that fails."""

    class _Camera(LifecycleNode):
        def on_configure(self, state: Any) -> TransitionCallbackReturn:
            self.images = self.create_lifecycle_publisher(String, "images", 10)
            return TransitionCallbackReturn.SUCCESS

        def on_activate(self, state: Any) -> TransitionCallbackReturn:
            super().on_activate(state)
            return TransitionCallbackReturn.FAILURE if self.fail else TransitionCallbackReturn.SUCCESS

        fail = True

    rclpy.init()
    camera = _Camera("camera")
    print(camera.trigger_configure().name, camera.trigger_activate().name)
    camera.fail = False
    print(camera.trigger_activate().name, camera.images.is_activated)
    fails("again", camera.trigger_configure)
    print(camera.trigger_deactivate().name, camera.images.is_activated)
    camera.images.publish(String(data="dropped"))
    print(camera.trigger_cleanup().name, camera.trigger_shutdown().name)
    fails("over", camera.trigger_configure)
    camera.destroy_node()
    rclpy.shutdown()


def times_and_durations() -> None:
    """Arithmetic of times, and clocks that do not mix."""
    with node() as made:
        now = made.get_clock().now()
        later = now + Duration(seconds=1, nanoseconds=5)
        print(later - now, later > now, (later - now).nanoseconds, Duration(seconds=1.5).to_msg())
        fails("clocks", lambda: now < Time(seconds=1))
        fails("minus", lambda: now - 5)
        fails("negative", Time, seconds=-1)
        fails("long", Duration, seconds=2**40)
        print(
            Time.from_msg(Time(seconds=3, nanoseconds=4).to_msg()),
            Time(nanoseconds=10**9).seconds_nanoseconds(),
        )
        rate = made.create_rate(50)
        thread = threading.Thread(target=rclpy.spin, args=(made,), daemon=True)
        thread.start()
        began = time.monotonic()
        for _ in range(3):
            rate.sleep()
        print(time.monotonic() - began > 0.03, made.destroy_rate(rate))
        fails("rate", made.create_rate, 0)
        rclpy.shutdown()
        thread.join(4)


def arguments_of_a_program() -> None:
    """What is left for the program's own parser."""
    given = ["prog", "--verbose", "--ros-args", "-r", "a:=b", "--", "file", "--ros-args", "-p", "x:=1"]
    print(remove_ros_args(given), rclpy.utilities.get_available_rmw_implementations() != set())
    rclpy.init(args=given)
    made = Node("prog")
    print(made.resolve_topic_name("a"), made.declare_parameter("x", 0).value)
    fails("again", rclpy.init)
    made.destroy_node()
    rclpy.shutdown()
    for wrong in (["--ros-args", "--nonsense"], ["--ros-args", "-p", "x"], ["--ros-args", "-r", "a b:=c"]):
        fails(wrong[1:], rclpy.init, args=wrong)
        rclpy.try_shutdown()
    print(wait(lambda: not rclpy.ok()))
