"""Programs for a robot, each written once. As a node, as a client, and without `await` they do the same.

A test turns this text into one that blocks by taking out what is asynchronous of each function here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rwt_participant.diagnostics import DiagnosticLevel, DiagnosticStatus, DiagnosticUpdater
from rwt_participant.errors import (
    CallFailed,
    CallTimeout,
    GoalAborted,
    GoalCanceled,
    GoalRejected,
    HandleClosed,
    InvalidMessage,
    NotFound,
    ParameterRejected,
    ProviderNotFound,
    RobotError,
    ServiceFailed,
    TimedOut,
    TransformUnavailable,
    UnknownType,
)
from rwt_participant.goals import GoalResult, GoalStatus, ReceivedGoal
from rwt_participant.qos import LATCHED, SENSOR_DATA
from rwt_participant.timers import Watchdog
from rwt_tf2 import Transform

ADD = "example_interfaces/AddTwoInts"
FIBONACCI = "example_interfaces/Fibonacci"
STRING = "std_msgs/String"

PATIENCE = 60.0

GIVES: dict[str, object] = {}
RAISES: dict[str, tuple[type[RobotError], str]] = {}


def gives(value: object) -> Callable[[Any], Any]:
    def note(program: Any) -> Any:
        GIVES[program.__name__] = value
        return program

    return note


def raises(error: type[RobotError], text: str = "") -> Callable[[Any], Any]:
    def note(program: Any) -> Any:
        RAISES[program.__name__] = (error, text)
        return program

    return note


# -- topics --------------------------------------------------------------------------------------------------


@gives(["one", "two", "three"])
async def hear_what_is_published(robot: Any) -> Any:
    async with robot.topic("/words", STRING) as words:
        robot.publish("/words", {"data": "one"}, STRING)
        robot.publish("/words", {"data": "two"})
        with await robot.advertise("/words", STRING) as publisher:
            publisher.publish({"data": "three"})
            heard = [(await words.get(timeout=PATIENCE)).data for _ in range(2)]
            async for word in words:
                return [*heard, word.data]


@gives("echo of hello")
async def tell_from_a_callback(robot: Any) -> Any:
    def answer(message: Any) -> None:
        robot.publish("/echo", {"data": f"echo of {message.data}"}, STRING)

    async with (
        robot.topic("/echo", STRING, qos=SENSOR_DATA) as echoes,
        robot.subscribe("/say", answer, STRING),
    ):
        robot.publish("/say", {"data": "hello"}, STRING)
        return (await echoes.get(timeout=PATIENCE)).data


@gives("kept")
async def hear_what_was_latched(robot: Any) -> Any:
    with robot.advertise("/latched", STRING, qos=LATCHED) as publisher:
        publisher.publish({"data": "kept"})
        return (await robot.once("/latched", STRING, timeout=PATIENCE)).data


@gives(12)
async def hear_a_topic_of_another_without_its_type(robot: Any) -> Any:
    return (await robot.once("/world/level", timeout=PATIENCE)).data


@raises(TimedOut, "no message came on /silence within 0.05 s")
async def hear_nothing(robot: Any) -> Any:
    await robot.once("/silence", STRING, timeout=0.05)


@raises(TimedOut, "no message came on /world/levl within 0.05 s; did you mean /world/level?")
async def hear_nothing_by_a_name_with_a_mistake(robot: Any) -> Any:
    await robot.once("/world/levl", "std_msgs/Int32", timeout=0.05)


@raises(NotFound, "; did you mean /world/level?")
async def publish_without_a_type_by_a_name_with_a_mistake(robot: Any) -> Any:
    await robot.publish("/world/levl", {"data": 1})


@raises(UnknownType, "did you mean std_msgs/String?")
async def subscribe_to_a_type_with_a_mistake(robot: Any) -> Any:
    await robot.subscribe("/words", print, "std_msgs/Strng")


@raises(InvalidMessage, 'std_msgs/String has no field "dta"; it has data')
async def publish_a_field_with_a_mistake(robot: Any) -> Any:
    robot.publish("/words", {"dta": "x"}, STRING)


@raises(HandleClosed, "the subscription to /words was closed")
async def take_from_what_is_closed(robot: Any) -> Any:
    words = await robot.topic("/words", STRING)
    words.close()
    await words.get(timeout=PATIENCE)


@raises(InvalidMessage, "data: expected string, got 3")
async def publish_what_does_not_fit(robot: Any) -> Any:
    robot.publish("/words", {"data": 3}, STRING)


@raises(UnknownType)
async def advertise_a_type_that_nobody_knows(robot: Any) -> Any:
    await robot.advertise("/words", "no_such_package/Type")


@raises(UnknownType)
async def subscribe_to_a_type_that_nobody_knows(robot: Any) -> Any:
    await robot.subscribe("/words", print, "no_such_package/Type")


@raises(NotFound, "/nothing")
async def publish_without_a_type(robot: Any) -> Any:
    await robot.publish("/nothing", {"data": "x"})


# -- services ------------------------------------------------------------------------------------------------


@gives(3)
async def call(robot: Any) -> Any:
    return (await robot.call("/world/add", {"a": 1, "b": 2}, ADD, timeout=PATIENCE)).sum


@gives((8, "the horn is off"))
async def serve(robot: Any) -> Any:
    def double(request: Any) -> object:
        if request.a < 0:
            raise ServiceFailed("the horn is off")
        return {"sum": 2 * request.a}

    with await robot.advertise_service("/double", ADD, double):
        doubled = (await robot.call("/double", {"a": 4})).sum
        try:
            await robot.call("/double", {"a": -1})
        except ServiceFailed as failure:
            return doubled, str(failure)


@gives(6)
async def serve_with_a_coroutine(robot: Any) -> Any:
    async def triple(request: Any) -> object:
        return {"sum": 3 * request.a}

    with robot.advertise_service("/triple", ADD, triple):
        return (await robot.call("/triple", {"a": 2})).sum


@raises(ProviderNotFound, "/nobody")
async def call_nobody(robot: Any) -> Any:
    await robot.call("/nobody")


@raises(ProviderNotFound, "Service /nobody does not exist")
async def call_nobody_by_a_type(robot: Any) -> Any:
    await robot.call("/nobody", {}, ADD)


@raises(ProviderNotFound, "; did you mean /world/add?")
async def call_by_a_name_with_a_mistake(robot: Any) -> Any:
    await robot.call("/world/ad", {"a": 1})


@raises(ProviderNotFound, "Service /world/ad does not exist; did you mean /world/add?")
async def call_by_a_name_with_a_mistake_and_a_type(robot: Any) -> Any:
    await robot.call("/world/ad", {"a": 1}, ADD)


@raises(CallTimeout)
async def call_what_does_not_answer(robot: Any) -> Any:
    await robot.call("/world/silent", timeout=0.05)


@raises(InvalidMessage, 'a: expected int64, got "x"')
async def call_with_what_does_not_fit(robot: Any) -> Any:
    await robot.call("/world/add", {"a": "x"})


@raises(UnknownType)
async def serve_a_type_that_nobody_knows(robot: Any) -> Any:
    await robot.advertise_service("/x", "no_such_package/Type", print)


# -- actions -------------------------------------------------------------------------------------------------


@gives(([[0], [0, 1]], "SUCCEEDED", [0, 1, 1]))
async def send_a_goal(robot: Any) -> Any:
    goal = await robot.send_goal("/world/fibonacci", {"order": 3})
    feedback = [list(each.sequence) async for each in goal]
    status, result = await goal.result(timeout=PATIENCE)
    return feedback, status.name, list(result.sequence)


@gives([GoalStatus.CANCELED, GoalStatus.ABORTED, GoalStatus.SUCCEEDED])
async def execute_goals(robot: Any) -> Any:
    async def execute(goal: ReceivedGoal) -> dict[str, object]:
        if goal.request.order == 0:
            goal.publish_feedback({"sequence": [1]})
            await goal.cancel_event.wait()
            raise GoalCanceled({"sequence": [7]})
        if goal.request.order == 1:
            raise GoalAborted({"sequence": [8]}, "no")
        return {"sequence": [9]}

    ends: list[GoalResult] = []
    with await robot.advertise_action("/work", FIBONACCI, execute):
        for order in range(3):
            goal = await robot.send_goal("/work", {"order": order}, FIBONACCI)
            if order == 0:
                async for _ in goal:
                    goal.cancel()
            ends.append(await goal.result(timeout=PATIENCE))
    assert [list(end.result.sequence) for end in ends] == [[7], [8], [9]]
    return [end.status for end in ends]


@raises(GoalRejected)
async def send_a_goal_that_is_rejected(robot: Any) -> Any:
    goal = await robot.send_goal("/world/fibonacci", {"order": 99})
    await goal.result(timeout=PATIENCE)


@raises(ProviderNotFound, "/nobody")
async def send_a_goal_to_nobody(robot: Any) -> Any:
    await robot.send_goal("/nobody")


@raises(ProviderNotFound, "Action /nobody does not exist")
async def send_a_goal_to_nobody_by_a_type(robot: Any) -> Any:
    goal = await robot.send_goal("/nobody", {}, FIBONACCI)
    await goal.result(timeout=PATIENCE)


@raises(ProviderNotFound, "; did you mean /world/fibonacci?")
async def send_a_goal_by_a_name_with_a_mistake(robot: Any) -> Any:
    await robot.send_goal("/world/fibonaci")


@raises(ProviderNotFound, "Action /world/fibonaci does not exist; did you mean /world/fibonacci?")
async def send_a_goal_by_a_name_with_a_mistake_and_a_type(robot: Any) -> Any:
    goal = await robot.send_goal("/world/fibonaci", {}, FIBONACCI)
    await goal.result(timeout=PATIENCE)


@raises(CallTimeout, "the goal of /world/idle has not ended within 0.05 s")
async def wait_too_short_for_a_goal(robot: Any) -> Any:
    goal = await robot.send_goal("/world/idle")
    await goal.result(timeout=0.05)


@raises(InvalidMessage, "order: ")
async def send_a_goal_that_does_not_fit(robot: Any) -> Any:
    await robot.send_goal("/world/fibonacci", {"order": "x"})


# -- what a robot needs on its own side ----------------------------------------------------------------------


@gives([1, 2, 3])
async def have_a_timer(robot: Any) -> Any:
    ticks = 0

    def tick() -> None:
        nonlocal ticks
        ticks += 1
        robot.publish("/ticks", {"data": ticks}, "std_msgs/Int32")

    async with robot.topic("/ticks", "std_msgs/Int32") as heard:
        timer = robot.create_timer(0.01, tick)
        numbers = [(await heard.get(timeout=PATIENCE)).data for _ in range(3)]
        timer.reset()
        timer.cancel()
        return numbers


@gives(["drives", "stands", "stands"])
async def stop_when_no_command_comes(robot: Any) -> Any:
    def tell(state: str) -> None:
        robot.publish("/motors", {"data": state}, STRING)

    def drive(command: Any) -> None:
        watchdog.feed()
        tell("drives")

    async with robot.topic("/motors", STRING) as motors:
        with (
            Watchdog(robot, 0.01, lambda: tell("stands")) as watchdog,
            await robot.subscribe("/command", drive, STRING),
        ):
            robot.publish("/command", {"data": "go"}, STRING)
            states = [(await motors.get(timeout=PATIENCE)).data for _ in range(2)]
        return [*states, (await motors.get(timeout=PATIENCE)).data]


@gives(("robot: motors", 1, "warm", "serial 7", [("celsius", "71")]))
async def tell_of_its_health(robot: Any) -> Any:
    updater = DiagnosticUpdater(robot, "robot", hardware_id="serial 7", period=0.01)
    updater.add("motors", lambda: DiagnosticStatus(DiagnosticLevel.WARN, "warm", {"celsius": 71}))
    found = await robot.once("/diagnostics", "diagnostic_msgs/DiagnosticArray", timeout=PATIENCE)
    updater.close()
    [status] = found.status
    values = [(pair.key, pair.value) for pair in status.values]
    return status.name, status.level, status.message, status.hardware_id, values


@gives(((0.0, 0.0, 0.5), (1.5, 0.0, 0.0)))
async def tell_where_it_is(robot: Any) -> Any:
    robot.tf.send_transform("base", "lamp", Transform((0.0, 0.0, 0.5)), static=True)
    lamp = await robot.tf.lookup("base", "lamp", timeout=PATIENCE)
    robot.tf.send_transform("map", "cart", Transform((1.5, 0.0, 0.0)))
    cart = await robot.tf.lookup("map", "cart", timeout=PATIENCE)
    return lamp.transform.translation, cart.transform.translation


@raises(InvalidMessage, "transforms: base cannot be its own parent")
async def tell_where_nothing_can_be(robot: Any) -> Any:
    robot.tf.send_transform("base", "base", Transform())


# -- parameters, transforms, time ----------------------------------------------------------------------------


@gives((0.5, True, False, 0.75, "otherwise", True))
async def use_parameters(robot: Any) -> Any:
    name = "/world:speed"
    before = await robot.params.get(name)
    has = await robot.params.has(name), await robot.params.has("/world:nothing")
    await robot.params.set(name, 0.75)
    after = await robot.params.get(name)
    await robot.params.set(name, before)
    other = await robot.params.get("/world:nothing", "otherwise")
    return before, *has, after, other, name in await robot.params.names()


@raises(ParameterRejected, "too fast")
async def set_a_parameter_that_is_refused(robot: Any) -> Any:
    await robot.params.set("/world:speed", 9.0)


@raises(ParameterRejected)
async def set_a_parameter_of_nobody(robot: Any) -> Any:
    await robot.params.set("/nobody:speed", 9.0)


@raises(NotFound)
async def get_a_parameter_that_is_not_there(robot: Any) -> Any:
    await robot.params.get("/world:nothing")


@raises(NotFound)
async def delete_a_parameter_that_is_not_there(robot: Any) -> Any:
    await robot.params.delete("/world:nothing")


@raises(ParameterRejected)
async def delete_a_parameter_of_a_fixed_type(robot: Any) -> Any:
    await robot.params.delete("/world:speed")


@gives((1.0, 2.0, 3.0))
async def look_up_a_transform(robot: Any) -> Any:
    return (await robot.tf.lookup("map", "base", timeout=PATIENCE)).transform.translation


@raises(TransformUnavailable, 'frame "ghost" is not known')
async def look_up_a_frame_that_nobody_knows(robot: Any) -> Any:
    await robot.tf.lookup("map", "base", timeout=PATIENCE)
    await robot.tf.lookup("map", "ghost", timeout=0.05)


@gives(True)
async def ask_the_time(robot: Any) -> Any:
    return await robot.time_ns() > 1_600_000_000_000_000_000


@gives(["ProviderNotFound", "CallTimeout", "ServiceFailed"])
async def catch_every_failed_call_by_one_name(robot: Any) -> Any:
    caught: list[str] = []
    for service in ("/nobody", "/world/silent", "/world/broken"):
        try:
            await robot.call(service, timeout=0.1)
        except CallFailed as failure:
            caught.append(type(failure).__name__)
    return caught


# -- listings and raw messages -------------------------------------------------------------------------------


@gives(
    (
        ("/world/level", "std_msgs/msg/Int32"),
        ("/world/add", "example_interfaces/srv/AddTwoInts"),
        ("/world/fibonacci", "example_interfaces/action/Fibonacci"),
    )
)
async def list_what_there_is(robot: Any) -> Any:
    topics, services, actions = await robot.topics(), await robot.services(), await robot.actions()
    assert [each.name for each in topics] == sorted(each.name for each in topics)
    names = "/world/level", "/world/add", "/world/fibonacci"
    return tuple((each.name, each.type) for each in (*topics, *services, *actions) if each.name in names)


@gives(("std_msgs/Int32", "std_msgs/String", "example_interfaces/AddTwoInts", "example_interfaces/Fibonacci"))
async def look_types_up(robot: Any) -> Any:
    interfaces = [await robot.interface(name) for name in (STRING, ADD, FIBONACCI)]
    return ((await robot.type_of("/world/level")).name, *[each.name for each in interfaces])


@raises(NotFound, "; did you mean /world/level?")
async def look_the_type_of_a_topic_up_by_a_name_with_a_mistake(robot: Any) -> Any:
    await robot.type_of("/world/levl")


@raises(UnknownType)
async def look_a_type_up_that_nobody_knows(robot: Any) -> Any:
    await robot.interface("no_such_package/Type")


@gives(("std_msgs/Int32", 12, True))
async def hear_serialised_messages(robot: Any) -> Any:
    heard: list[Any] = []

    def take(message: Any) -> None:
        heard.append(message)
        robot.publish("/heard", {"data": "one"}, STRING)

    async with robot.topic("/heard", STRING) as told:
        with await robot.subscribe_raw("/world/level", take):
            await told.get(timeout=PATIENCE)
    (message,) = heard
    return (message.type.name, message.type.deserialise(message.data).data, message.stamp_ns is not None)


@gives((GoalStatus.CANCELED, True))
async def cancel_a_goal_by_its_id(robot: Any) -> Any:
    async def wait(goal: ReceivedGoal) -> None:
        await goal.cancel_event.wait()
        raise GoalCanceled

    with await robot.advertise_action("/wait", FIBONACCI, wait):
        goal = await robot.send_goal("/wait", {"order": 2}, FIBONACCI)
        robot.cancel_goal("/wait", goal.id)
        robot.cancel_goal("/wait", "0" * 32)
        return ((await goal.result(timeout=PATIENCE)).status, goal.done)
