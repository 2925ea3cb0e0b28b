"""Runs named scenarios with `roslibpy`, as PyPI ships it, and prints what each observed, one JSON line each.

Usage: ``python roslibpy_program.py URL [SCENARIO …]``; without names they are read from standard input, one
a line. A scenario may take one argument, separated by a space: ``listen /words``. Nothing is asserted here:
the tests compare what is printed with what they expect.
"""

from __future__ import annotations

import json
import logging
import queue
import sys
import threading
import traceback
from collections.abc import Callable, Iterable
from time import monotonic, sleep, time
from typing import Any

import roslibpy
import roslibpy.ros1.actionlib as actionlib
import roslibpy.ros2
import roslibpy.tf

#: Seconds after which a wait inside a scenario is given up.
LIMIT = 10.0
ADD = "example_interfaces/AddTwoInts"
STRING = "std_msgs/String"
FIBONACCI = "example_interfaces/Fibonacci"
FIBONACCI_ACTION = "actionlib_tutorials/FibonacciAction"

#: The states of `actionlib.GoalStatus` that a goal does not leave.
ENDS = frozenset({2, 3, 4, 5, 8, 9})

#: Whatever is on the wire or comes from the library, which has no types.
Value = Any


class Complaints(logging.Handler):
    """Errors that the library and its event loop have logged since the last scenario."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        cause = f": {record.exc_info[1]!r}" if record.exc_info else ""
        self.texts.append(record.getMessage() + cause)

    def take(self) -> list[str]:
        texts, self.texts = self.texts, []
        return texts


class Connections:
    """Everything one scenario opens, so that it is closed again whatever happens."""

    def __init__(self, url: str) -> None:
        self.url = url
        self._opened: list[Value] = []

    def open(self) -> Value:
        ros = roslibpy.Ros(self.url)
        self._opened.append(ros)
        try:
            ros.run(timeout=LIMIT)
        except roslibpy.core.RosTimeoutError:
            # roslibpy misses the event if it arrives between its check and its registration.
            if not ros.is_connected:
                raise
        return ros

    def close_all(self) -> None:
        for ros in self._opened:
            disconnect(ros)


class Gathered:
    """The messages of one topic in the order in which they came."""

    def __init__(self, ros: Value, name: str, type_: str | None, **options: Value) -> None:
        self.topic = roslibpy.Topic(ros, name, type_, **options)
        self.messages: list[Value] = []
        self._arrived: queue.SimpleQueue[Value] = queue.SimpleQueue()
        self.topic.subscribe(self._take)
        settled(ros)

    def _take(self, message: Value) -> None:
        self.messages.append(message)
        self._arrived.put(message)

    def next(self) -> Value:
        return self._arrived.get(timeout=LIMIT)

    def data(self, count: int) -> list[Value]:
        """The field `data` of the next `count` messages."""
        return [self.next()["data"] for _ in range(count)]


def disconnect(ros: Value) -> None:
    if ros.is_connected:
        closed = threading.Event()
        ros.on("close", lambda _: closed.set())
        ros.close()
        closed.wait(LIMIT)


def settled(ros: Value) -> None:
    """Return when the server has done everything sent before on this connection."""
    call(ros, "/rosapi/topic_type", "rosapi/TopicType", {"topic": "/chatter"})


def publish(ros: Value, name: str, type_: str, *messages: Value, **options: Value) -> Value:
    topic = roslibpy.Topic(ros, name, type_, **options)
    for message in messages:
        topic.publish(roslibpy.Message(message))
    return topic


def words(*texts: str) -> list[Value]:
    return [{"data": text} for text in texts]


def call(ros: Value, name: str, type_: str, request: Value) -> Value:
    """The answer as `values`, or the reason of the failure as `failed`."""
    answers: queue.SimpleQueue[Value] = queue.SimpleQueue()
    roslibpy.Service(ros, name, type_).call(
        roslibpy.ServiceRequest(request),
        lambda values: answers.put({"values": dict(values)}),
        lambda reason: answers.put({"failed": reason}),
    )
    return answers.get(timeout=LIMIT)


def ask(method: Callable[..., Value], *given: Value) -> Value:
    """As `call`, for a method of the library; it blocks and raises."""
    try:
        answer = method(*given)
    except roslibpy.core.ServiceException as error:
        return {"failed": str(error)}
    return {"values": dict(answer) if isinstance(answer, roslibpy.ServiceResponse) else answer}


def exchange(connections: Connections, name: str, type_: str, *messages: Value) -> list[Value]:
    """Messages that one connection receives from another."""
    heard = Gathered(connections.open(), f"/roslibpy/{name}", type_)
    publish(connections.open(), f"/roslibpy/{name}", type_, *messages)
    return [heard.next() for _ in messages]


# -- topics


def publish_and_subscribe(connections: Connections, _: str) -> Value:
    spoken = words("one", 'zwei "äöü" \\ /', "三 \N{ROBOT FACE} \0\n", "")
    return [message["data"] for message in exchange(connections, "words", STRING, *spoken)]


def own_publication_comes_back(connections: Connections, _: str) -> Value:
    ros = connections.open()
    heard = Gathered(ros, "/roslibpy/own", STRING)
    publish(ros, "/roslibpy/own", STRING, *words("mine"))
    return heard.data(1)


def three_part_type(connections: Connections, _: str) -> Value:
    return [
        message["data"]
        for message in exchange(connections, "three_part", "std_msgs/msg/String", *words("modern"))
    ]


def relative_name(connections: Connections, _: str) -> Value:
    heard = Gathered(connections.open(), "roslibpy_relative", STRING)
    publish(connections.open(), "/roslibpy_relative", STRING, *words("near"))
    return heard.data(1)


def type_inferred(connections: Connections, _: str) -> Value:
    speaking = connections.open()
    topic = roslibpy.Topic(speaking, "/roslibpy/inferred", STRING)
    topic.advertise()
    settled(speaking)
    heard = Gathered(connections.open(), "/roslibpy/inferred", None)
    topic.publish(roslibpy.Message({"data": "known"}))
    return heard.data(1)


def partial_message(connections: Connections, _: str) -> Value:
    return exchange(connections, "partial", "geometry_msgs/Twist", {"linear": {"x": 1.5}})[0]


def values(connections: Connections, _: str) -> Value:
    sent = [
        ("Float64", {"data": 0.1}),
        ("Float64", {"data": None}),
        ("Float64", {"data": 3}),
        ("Float32", {"data": 0.1}),
        ("Int64", {"data": 2**53 - 1}),
        ("Int64", {"data": 1 - 2**53}),
        ("Bool", {"data": True}),
        ("UInt8MultiArray", {"data": [1, 2, 255]}),
        ("UInt8MultiArray", {"data": "AQL/"}),
        ("UInt8MultiArray", {"data": []}),
        ("Int8MultiArray", {"data": [-1, 2]}),
        ("Float64MultiArray", {"data": [1, None, 2.5]}),
        ("ColorRGBA", {"r": 1}),
    ]
    received = []
    for index, (type_, message) in enumerate(sent):
        [heard] = exchange(connections, f"value_{index}", f"std_msgs/{type_}", message)
        received.append([type_, heard if type_ == "ColorRGBA" else heard["data"]])
    return received


def exact_integers(connections: Connections, _: str) -> Value:
    signed = exchange(
        connections, "int64", "std_msgs/Int64", {"data": 2**63 - 1}, {"data": -(2**63)}, {"data": 2**53 + 1}
    )
    unsigned = exchange(connections, "uint64", "std_msgs/UInt64", {"data": 2**64 - 1})
    return [message["data"] for message in (*signed, *unsigned)]


def header_is_stamped(connections: Connections, _: str) -> Value:
    empty, given = exchange(
        connections,
        "stamped",
        "geometry_msgs/PointStamped",
        {"header": {}, "point": {"x": 1}},
        {"header": {"stamp": {"secs": 12, "nsecs": 34}, "frame_id": "map"}},
    )
    return {"empty": empty, "given": given, "now": time()}


def library_header(connections: Connections, distro: str) -> Value:
    """The library's own header of each generation; the older one sends `seq: null`."""
    header_type = roslibpy.Header if distro == "noetic" else roslibpy.ros2.Header
    header = header_type(stamp=roslibpy.Time(12, 34), frame_id="map")
    [message] = exchange(
        connections, "header", "geometry_msgs/PointStamped", {"header": dict(header), "point": {"x": 1}}
    )
    return message


def time_in_either_spelling(connections: Connections, _: str) -> Value:
    sent: list[Value] = [{"stamp": {"sec": 1, "nanosec": 2}}, {"stamp": {"secs": 3, "nsecs": 4}}]
    return [header["stamp"] for header in exchange(connections, "times", "std_msgs/Header", *sent)]


def bad_messages_are_dropped(connections: Connections, _: str) -> Value:
    heard = Gathered(connections.open(), "/roslibpy/dropped", STRING)
    sent: list[Value] = [
        {"data": "first"},
        {"data": 7},
        {"bogus": 1},
        {"data": "x", "bogus": 1},
        {"data": "last"},
    ]
    publish(connections.open(), "/roslibpy/dropped", STRING, *sent)
    return heard.data(2)


def type_conflict(connections: Connections, _: str) -> Value:
    hearing, speaking, wrong = connections.open(), connections.open(), connections.open()
    heard = Gathered(hearing, "/roslibpy/conflict", STRING)
    publish(wrong, "/roslibpy/conflict", "std_msgs/Int32", {"data": 1})
    settled(wrong)
    publish(speaking, "/roslibpy/conflict", STRING, *words("still text"))
    return {"received": heard.data(1), "type": ask(hearing.get_topic_type, "/roslibpy/conflict")}


def throttled(connections: Connections, _: str) -> Value:
    """One burst into three throttled subscriptions with queues of 0, 1 and 2: what each was given."""
    name = "/roslibpy/throttled"
    heard = [
        Gathered(connections.open(), name, STRING, throttle_rate=300, queue_length=length)
        for length in range(3)
    ]
    speaking = connections.open()
    start = monotonic()
    publish(speaking, name, STRING, *words(*map(str, range(10))))
    milliseconds = []
    for length, each in enumerate(heard):
        each.data(length + 1)
        milliseconds.append(1000 * (monotonic() - start))
    sleep(0.4)
    return [
        {"received": [message["data"] for message in each.messages], "milliseconds": elapsed}
        for each, elapsed in zip(heard, milliseconds, strict=True)
    ]


def latched(connections: Connections, _: str) -> Value:
    speaking = connections.open()
    topic = publish(speaking, "/roslibpy/latched", STRING, *words("old", "kept"), latch=True)
    settled(speaking)
    late = [Gathered(connections.open(), "/roslibpy/latched", STRING) for _ in range(2)]
    topic.publish(roslibpy.Message({"data": "new"}))
    return [heard.data(2) for heard in late]


def unsubscribe(connections: Connections, _: str) -> Value:
    hearing = connections.open()
    left = Gathered(hearing, "/roslibpy/left", STRING)
    stays = Gathered(connections.open(), "/roslibpy/left", STRING)
    topic = publish(connections.open(), "/roslibpy/left", STRING, *words("one"))
    left.next()
    left.topic.unsubscribe()
    settled(hearing)
    topic.publish(roslibpy.Message({"data": "two"}))
    stayed = stays.data(2)
    settled(hearing)
    return {"left": [message["data"] for message in left.messages], "stays": stayed}


def many_in_order(connections: Connections, _: str) -> Value:
    texts = [str(number) for number in range(500)]
    received = [message["data"] for message in exchange(connections, "many", STRING, *words(*texts))]
    return len(received) if received == texts else received


def large_message(connections: Connections, _: str) -> Value:
    text = "0123456789abcdef" * 65536
    [message] = exchange(connections, "large", STRING, *words(text))
    return {"length": len(message["data"]), "same": message["data"] == text}


def reconnect(connections: Connections, _: str) -> Value:
    """The library subscribes and advertises again by itself, one second after the loss."""
    hearing, speaking = connections.open(), connections.open()
    heard = Gathered(hearing, "/roslibpy/again", STRING)
    topic = publish(speaking, "/roslibpy/again", STRING, *words("before"))
    received = heard.data(1)
    for ros in (hearing, speaking):
        disconnect(ros)
    for ros in (hearing, speaking):
        ros.connect()
        ros.run(timeout=LIMIT)
    # Only after that second does the library send the subscription again.
    sleep(1.5)
    settled(hearing)
    topic.publish(roslibpy.Message({"data": "after"}))
    return received + heard.data(1)


def set_level(connections: Connections, _: str) -> Value:
    ros = connections.open()
    heard = Gathered(connections.open(), "/roslibpy/level", STRING)
    for level in ("none", "error", "warning", "info"):
        ros.set_status_level(level, f"level:{level}")
        publish(ros, "/roslibpy/level", STRING, *words(level))
    # The library logs an error for each status frame, which at level info tell of success.
    return heard.data(4)


# -- services


def provide(connections: Connections, name: str, handler: Callable[[Value, Value], bool]) -> Value:
    ros = connections.open()
    service = roslibpy.Service(ros, f"/roslibpy/{name}", ADD)
    service.advertise(handler)
    settled(ros)
    return service


def add(request: Value, response: Value) -> bool:
    response["sum"] = request["a"] + request["b"]
    return True


def call_service(connections: Connections, _: str) -> Value:
    ros = connections.open()
    return {
        "named": call(ros, "/add_two_ints", ADD, {"a": 1, "b": 2}),
        "partial": call(ros, "/add_two_ints", ADD, {"a": 4}),
        "empty": call(ros, "/add_two_ints", ADD, {}),
        "relative": call(ros, "add_two_ints", ADD, {"a": -1, "b": -2}),
    }


def call_unknown(connections: Connections, _: str) -> Value:
    return call(connections.open(), "/no_such_service", ADD, {})


def call_bad_arguments(connections: Connections, _: str) -> Value:
    ros = connections.open()
    return {
        "unknown_field": call(ros, "/add_two_ints", ADD, {"bogus": 1}),
        "wrong_type": call(ros, "/add_two_ints", ADD, {"a": "one"}),
        "afterwards": call(ros, "/add_two_ints", ADD, {"a": 1}),
    }


def provide_success(connections: Connections, _: str) -> Value:
    provide(connections, "adds", add)
    caller = connections.open()
    return {
        "answer": call(caller, "/roslibpy/adds", ADD, {"a": 40, "b": 2}),
        "defaults": call(caller, "/roslibpy/adds", ADD, {}),
        "type": ask(caller.get_service_type, "/roslibpy/adds"),
    }


def provide_failure(connections: Connections, _: str) -> Value:
    provide(connections, "refuses", lambda request, response: False)
    return call(connections.open(), "/roslibpy/refuses", ADD, {"a": 1})


def provide_exception(connections: Connections, _: str) -> Value:
    """The library logs what the handler raised and sends no answer at all."""

    def handler(request: Value, response: Value) -> bool:
        msg = "no power"
        raise RuntimeError(msg)

    provide(connections, "throws", handler)
    return call(connections.open(), "/roslibpy/throws", ADD, {"a": 1})


def provide_bad_answer(connections: Connections, _: str) -> Value:
    def handler(request: Value, response: Value) -> bool:
        response["sum"] = "a lot"
        return True

    provide(connections, "lies", handler)
    return call(connections.open(), "/roslibpy/lies", ADD, {"a": 1})


def provide_on_own_connection(connections: Connections, _: str) -> Value:
    service = provide(connections, "own", add)
    return call(service.ros, "/roslibpy/own", ADD, {"a": 7})


def provider_unadvertises(connections: Connections, _: str) -> Value:
    service = provide(connections, "leaves", add)
    service.unadvertise()
    settled(service.ros)
    return call(connections.open(), "/roslibpy/leaves", ADD, {})


def serve(connections: Connections, name: str) -> Value:
    """One call answered for another program, which is told that this one is there."""
    calls: queue.SimpleQueue[Value] = queue.SimpleQueue()

    def handler(request: Value, response: Value) -> bool:
        calls.put(request)
        return add(request, response)

    ros = connections.open()
    roslibpy.Service(ros, name, ADD).advertise(handler)
    publish(ros, f"{name}/ready", STRING, *words("ready"), latch=True)
    given = calls.get(timeout=LIMIT)
    settled(ros)
    return given


def call_other(connections: Connections, name: str) -> Value:
    ros = connections.open()
    Gathered(ros, f"{name}/ready", STRING).next()
    return call(ros, name, ADD, {"a": 5, "b": 6})


def serve_for_ever(connections: Connections, name: str) -> Value:
    """Take a call and never answer it; the test ends this program while the call is pending."""
    calls: queue.SimpleQueue[Value] = queue.SimpleQueue()
    ros = connections.open()

    def handler(request: Value, response: Value) -> bool:
        calls.put(request)
        sys.stdout.write("called\n")
        sys.stdout.flush()
        threading.Event().wait()
        return True

    roslibpy.Service(ros, name, ADD).advertise(handler)
    publish(ros, f"{name}/ready", STRING, *words("ready"), latch=True)
    return calls.get(timeout=LIMIT)


# -- rosapi and parameters


def rosapi_topics(connections: Connections, _: str) -> Value:
    ros = connections.open()
    return {
        "topics": ask(ros.get_topics),
        "type": ask(ros.get_topic_type, "/odom"),
        "unknown": ask(ros.get_topic_type, "/no_such_topic"),
        "of_type": ask(ros.get_topics_for_type, "nav_msgs/Odometry"),
        "of_three_part_type": ask(ros.get_topics_for_type, "nav_msgs/msg/Odometry"),
    }


def rosapi_services(connections: Connections, _: str) -> Value:
    ros = connections.open()
    type_ = ros.get_service_type("/add_two_ints")
    return {
        "services": ask(ros.get_services),
        "type": type_,
        "unknown": ask(ros.get_service_type, "/no_such_service"),
        "of_type": ask(ros.get_services_for_type, type_),
        "request": ask(ros.get_service_request_details, type_),
        "response": ask(ros.get_service_response_details, type_),
    }


def rosapi_nodes(connections: Connections, _: str) -> Value:
    ros = connections.open()
    return {"nodes": ask(ros.get_nodes), "details": ros.get_node_details("/demo_robot")}


def rosapi_messages(connections: Connections, _: str) -> Value:
    ros = connections.open()
    return {
        "details": ask(ros.get_message_details, "geometry_msgs/Twist"),
        "unknown": ask(ros.get_message_details, "no_such_msgs/Thing"),
    }


def rosapi_actions(connections: Connections, _: str) -> Value:
    servers: queue.SimpleQueue[Value] = queue.SimpleQueue()
    connections.open().get_action_servers(lambda answer: servers.put({"values": answer["action_servers"]}))
    return servers.get(timeout=LIMIT)


def rosapi_time(connections: Connections, _: str) -> Value:
    """The library knows the field names of ROS 1 alone."""
    return {"server": connections.open().get_time().to_sec(), "now": time()}


def has_param(ros: Value, name: str) -> Value:
    return call(ros, "/rosapi/has_param", "rosapi/HasParam", {"name": name})


def robot_parameter(connections: Connections, name: str) -> Value:
    ros = connections.open()
    before = ros.get_param(name)
    ros.set_param(name, 0.25)
    after = ros.get_param(name)
    ros.set_param(name, before)
    return {
        "listed": name in ros.get_params(),
        "before": {"values": before},
        "after": {"values": after},
        "has": has_param(ros, name),
    }


def refused_parameter(connections: Connections, name: str) -> Value:
    ros = connections.open()
    before = ros.get_param(name)
    word, negative = (
        call(ros, "/rosapi/set_param", "rosapi/SetParam", {"name": name, "value": value})
        for value in ('"fast"', "-1.5")
    )
    return {"word": word, "negative": negative, "unchanged": ros.get_param(name) == before}


def own_parameter(connections: Connections, _: str) -> Value:
    ros = connections.open()
    parameter = roslibpy.Param(ros, "/roslibpy/answer")
    had = has_param(ros, parameter.name)
    kept = []
    for value in (42, -0.5, 'text "ü"', True, [1, 2, 3], ["a", "b"]):
        parameter.set(value, timeout=LIMIT)
        kept.append(parameter.get(timeout=LIMIT))
    listed, has_now = parameter.name in ros.get_params(), has_param(ros, parameter.name)
    parameter.delete(timeout=LIMIT)
    return {
        "had": had,
        "kept": kept,
        "listed": listed,
        "has_now": has_now,
        "has_after": has_param(ros, parameter.name),
        "get_after": ask(parameter.get),
    }


# -- the demo robot


def drive(connections: Connections, _: str) -> Value:
    """Drive for a second, let go of the stick and wait until the robot has stopped by itself."""
    ros = connections.open()
    call(ros, "/reset", "std_srvs/Empty", {})
    odometry = Gathered(ros, "/odom", "nav_msgs/Odometry")
    before = odometry.next()["pose"]["pose"]["position"]
    stick = roslibpy.Topic(ros, "/cmd_vel", "geometry_msgs/Twist")
    for _step in range(10):
        stick.publish(roslibpy.Message({"linear": {"x": 0.3}}))
        sleep(0.1)
    deadline = monotonic() + LIMIT
    while odometry.messages[-1]["twist"]["twist"]["linear"]["x"] != 0 and monotonic() < deadline:
        sleep(0.01)
    speeds = [message["twist"]["twist"]["linear"]["x"] for message in odometry.messages]
    after = odometry.messages[-1]["pose"]["pose"]["position"]
    return {
        "before": [before["x"], before["y"]],
        "after": [after["x"], after["y"]],
        "fastest": max(speeds),
        "speed": speeds[-1],
    }


# -- actions


class SentGoal:
    """One ROS 2 goal and what came back."""

    def __init__(self, ros: Value, name: str, goal: Value) -> None:
        self.client = roslibpy.ActionClient(ros, name, FIBONACCI)
        self.feedback: list[Value] = []
        self.started = threading.Event()
        self._ended: queue.SimpleQueue[Value] = queue.SimpleQueue()
        self.id = self.client.send_goal(
            roslibpy.Goal(goal),
            lambda result: self._end("result", result),
            self._take,
            lambda result: self._end("failed", result),
        )

    def _take(self, feedback: Value) -> None:
        self.feedback.append(feedback["sequence"])
        self.started.set()

    def _end(self, how: str, result: Value) -> None:
        self._ended.put({how: result["values"], "status": result["status"].value})

    def end(self) -> Value:
        return {**self._ended.get(timeout=LIMIT), "feedback": self.feedback}

    def cancel(self) -> None:
        self.started.wait(LIMIT)
        self.client.cancel_goal(self.id)


def action_goal(connections: Connections, _: str) -> Value:
    return SentGoal(connections.open(), "/fibonacci", {"order": 4}).end()


def action_cancel(connections: Connections, _: str) -> Value:
    goal = SentGoal(connections.open(), "/fibonacci", {"order": 40})
    goal.cancel()
    return goal.end()


def action_refused(connections: Connections, _: str) -> Value:
    ros = connections.open()
    return {
        "unknown": SentGoal(ros, "/no_such_action", {"order": 1}).end(),
        "bad_field": SentGoal(ros, "/fibonacci", {"bogus": 1}).end(),
        "by_the_server": SentGoal(ros, "/fibonacci", {"order": 47}).end(),
    }


def send_goals(connections: Connections, name: str) -> Value:
    """Three goals to an action that another program provides."""
    ros = connections.open()
    Gathered(ros, f"{name}/ready", STRING).next()
    succeeded = SentGoal(ros, name, {"order": 7}).end()
    aborted = SentGoal(ros, name, {"order": -1}).end()
    running = SentGoal(ros, name, {"order": 100})
    running.cancel()
    canceled = running.end()
    publish(ros, f"{name}/done", STRING, *words("done"), latch=True)
    settled(ros)
    return {"succeeded": succeeded, "aborted": aborted, "canceled": canceled}


class SentActionlibGoal:
    """One ROS 1 goal and what came back."""

    def __init__(self, client: Value, order: int) -> None:
        self.goal = actionlib.Goal(client, roslibpy.Message({"order": order}))
        self.feedback: list[Value] = []
        self.statuses: list[int] = []
        self.started = threading.Event()
        self._ended = threading.Event()
        self._results: queue.SimpleQueue[Value] = queue.SimpleQueue()
        self.goal.on("feedback", self._take)
        self.goal.on("status", self._take_status)
        self.goal.on("result", self._results.put)
        self.goal.send()

    def _take(self, feedback: Value) -> None:
        self.feedback.append(feedback["sequence"])
        self.started.set()

    def _take_status(self, status: Value) -> None:
        if self.statuses[-1:] != [status["status"]]:
            self.statuses.append(status["status"])
        if status["status"] in ENDS:
            self._ended.set()

    def end(self) -> Value:
        result = self._results.get(timeout=LIMIT)
        # This client learns the final state from the status topic alone, and takes PREEMPTING for an end.
        self._ended.wait(LIMIT)
        return {
            "result": result["sequence"],
            "status": self.statuses[-1],
            "statuses": self.statuses,
            "feedback": self.feedback,
        }


def actionlib_goal(connections: Connections, _: str) -> Value:
    client = actionlib.ActionClient(connections.open(), "/fibonacci", FIBONACCI_ACTION)
    return SentActionlibGoal(client, 4).end()


def actionlib_cancel(connections: Connections, _: str) -> Value:
    client = actionlib.ActionClient(connections.open(), "/fibonacci", FIBONACCI_ACTION)
    running = SentActionlibGoal(client, 40)
    running.started.wait(LIMIT)
    running.goal.cancel()
    return running.end()


def actionlib_cancel_all(connections: Connections, _: str) -> Value:
    client = actionlib.ActionClient(connections.open(), "/fibonacci", FIBONACCI_ACTION)
    running = SentActionlibGoal(client, 40)
    running.started.wait(LIMIT)
    client.cancel()
    return running.end()


def actionlib_server(connections: Connections, _: str) -> Value:
    """A server in this client, which counts, and works on a large order until it is cancelled."""
    name = "/roslibpy/fibonacci"
    server = actionlib.SimpleActionServer(connections.open(), name, FIBONACCI_ACTION)

    def execute(goal: Value) -> None:
        server.send_feedback({"sequence": [0]})
        if goal["order"] < 100:
            server.set_succeeded({"sequence": [0, 1, 1]})
            return
        while not server.is_preempt_requested():
            sleep(0.01)
        server.set_preempted()

    server.start(execute)
    client = actionlib.ActionClient(connections.open(), name, FIBONACCI_ACTION)
    succeeded = SentActionlibGoal(client, 2).end()
    running = SentActionlibGoal(client, 100)
    running.started.wait(LIMIT)
    running.goal.cancel()
    return {"succeeded": succeeded, "preempted": running.end()}


# -- transforms


def tf_service(connections: Connections, _: str) -> Value:
    """Where the laser and then the robot are; the second frame makes the client ask anew. Then it drives."""
    ros = connections.open()
    call(ros, "/reset", "std_srvs/Empty", {})
    heard: dict[str, list[Value]] = {"laser": [], "/base_link": []}
    client = roslibpy.tf.TFClient(
        ros, fixed_frame="/odom", angular_threshold=0.01, translation_threshold=0.01, rate=20
    )
    for frame, transforms in heard.items():
        client.subscribe(frame, transforms.append)
        wait_for(transforms.__len__)
    base = heard["/base_link"]
    before = base[-1]["translation"]
    stick = roslibpy.Topic(ros, "/cmd_vel", "geometry_msgs/Twist")
    while base[-1]["translation"]["x"] < before["x"] + 0.1:
        stick.publish(roslibpy.Message({"linear": {"x": 0.3}}))
        sleep(0.05)
    client.dispose()
    settled(ros)
    return {
        "laser": heard["laser"][0],
        "before": before,
        "moved": base[-1]["translation"]["x"] - before["x"],
    }


def wait_for(condition: Callable[[], Value]) -> None:
    deadline = monotonic() + LIMIT
    while not condition():
        if monotonic() > deadline:
            raise TimeoutError(f"nothing came within {LIMIT:g} s")
        sleep(0.005)


# -- conversations with another program


def listen(connections: Connections, name: str) -> Value:
    ros = connections.open()
    heard = Gathered(ros, name, STRING)
    publish(ros, f"{name}/ready", STRING, *words("ready"), latch=True)
    return heard.data(3)


def hear_one(connections: Connections, name: str) -> Value:
    return Gathered(connections.open(), name, STRING).next()["data"]


def talk(connections: Connections, name: str) -> Value:
    ros = connections.open()
    Gathered(ros, f"{name}/ready", STRING).next()
    publish(ros, name, STRING, *words("grüße", "二", "3"))
    settled(ros)
    return "said"


SCENARIOS: dict[str, Callable[[Connections, str], Value]] = {
    "call": call_service,
    **{
        scenario.__name__: scenario
        for scenario in (
            publish_and_subscribe,
            own_publication_comes_back,
            three_part_type,
            relative_name,
            type_inferred,
            partial_message,
            values,
            exact_integers,
            header_is_stamped,
            library_header,
            time_in_either_spelling,
            bad_messages_are_dropped,
            type_conflict,
            throttled,
            latched,
            unsubscribe,
            many_in_order,
            large_message,
            reconnect,
            set_level,
            call_unknown,
            call_bad_arguments,
            provide_success,
            provide_failure,
            provide_exception,
            provide_bad_answer,
            provide_on_own_connection,
            provider_unadvertises,
            serve,
            call_other,
            serve_for_ever,
            rosapi_topics,
            rosapi_services,
            rosapi_nodes,
            rosapi_messages,
            rosapi_actions,
            rosapi_time,
            robot_parameter,
            refused_parameter,
            own_parameter,
            drive,
            action_goal,
            action_cancel,
            action_refused,
            send_goals,
            actionlib_goal,
            actionlib_cancel,
            actionlib_cancel_all,
            actionlib_server,
            tf_service,
            listen,
            hear_one,
            talk,
        )
    },
}


def observe(url: str, line: str, complaints: Complaints) -> Value:
    name, _, argument = line.partition(" ")
    report: Value = {"scenario": line}
    connections = Connections(url)
    try:
        report["observed"] = SCENARIOS[name](connections, argument)
    except Exception:
        report["failed"] = traceback.format_exc()
    finally:
        connections.close_all()
    report["complaints"] = complaints.take()
    return report


def plain(value: object) -> object:
    """The library's dictionaries, which `json` does not know."""
    if isinstance(value, roslibpy.Message | roslibpy.ServiceResponse | roslibpy.Feedback):
        return dict(value)
    msg = f"{value!r} is not JSON"
    raise TypeError(msg)


def run(url: str, lines: Iterable[str]) -> None:
    complaints = Complaints()
    logging.getLogger().addHandler(complaints)
    for line in lines:
        report = observe(url, line.strip(), complaints)
        sys.stdout.write(json.dumps(report, default=plain) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    run(sys.argv[1], sys.argv[2:] or sys.stdin)
