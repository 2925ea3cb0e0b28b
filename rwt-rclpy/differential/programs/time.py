"""Times, durations and clocks."""

import builtins
from typing import Any

import rclpy
from builtin_interfaces.msg import Duration as DurationMessage
from builtin_interfaces.msg import Time as TimeMessage
from rclpy.clock import Clock, ClockChange, JumpThreshold, ROSClock
from rclpy.duration import Duration, Infinite
from rclpy.time import ClockType, Time
from rosgraph_msgs.msg import Clock as ClockMessage

from differential.steps import node, public, spinner, tell

NUMBERS = (0, 1, -1, 1.5, 1e-9, 1e9, 10**10, 2**63, True, None, float("inf"), float("nan"))


def durations() -> None:
    """Construction."""
    for number in NUMBERS:
        tell(f"seconds {number}", lambda n=number: Duration(seconds=n).nanoseconds)
        tell(f"nanoseconds {number}", lambda n=number: Duration(nanoseconds=n).nanoseconds)
    tell("positional", lambda: Duration(1))


def duration_text() -> None:
    """Text of durations."""
    for each in (Duration(), Duration(seconds=1.5), Duration(nanoseconds=-1), Infinite):
        print(str(each), repr(each))


def duration_arithmetic() -> None:
    """Operators of durations."""
    one, two = Duration(seconds=1), Duration(seconds=2)
    for label, call in (
        ("add", lambda: one + two),
        ("subtract", lambda: one - two),
        ("negate", lambda: -one),
        ("times", lambda: one * 2),
        ("times float", lambda: one * 1.5),
        ("number times", lambda: 2 * one),
        ("divided", lambda: two / 2),
        ("by duration", lambda: two / one),
        ("absolute", lambda: abs(one)),
        ("add number", lambda: one + 1),
        ("add to infinite", lambda: Infinite + one),
        ("bool", lambda: bool(Duration())),
        ("int", lambda: int(one)),
        ("sum", lambda: sum([one, two], Duration())),
        ("times infinity", lambda: one * float("inf")),
        ("times nan", lambda: one * float("nan")),
        ("times true", lambda: one * True),
    ):
        tell(label, call)


def duration_comparison() -> None:
    """Comparison and hash."""
    one, two = Duration(seconds=1), Duration(seconds=2)
    print(
        one < two,
        one <= two,
        one > two,
        one >= two,
        one == two,
        one != two,
        one == Duration(nanoseconds=10**9),
    )
    print(one == 1, one != 1, one == DurationMessage(sec=1), one == TimeMessage(sec=1))
    tell("less than number", lambda: one < 1)
    tell("hash", lambda: bool(hash(one)) or True)
    tell("set", lambda: len({one, two}))


def duration_messages() -> None:
    """Conversion to messages."""
    for each in (Duration(seconds=1.5), Duration(nanoseconds=-1), Infinite, Duration(seconds=-1.5)):
        tell(repr(each), each.to_msg)
    tell("from", lambda: Duration.from_msg(DurationMessage(sec=1, nanosec=5)))
    tell("from time", lambda: Duration.from_msg(TimeMessage(sec=1)))


def times() -> None:
    """Construction."""
    for number in NUMBERS:
        tell(f"seconds {number}", lambda n=number: Time(seconds=n).nanoseconds)
        tell(f"nanoseconds {number}", lambda n=number: Time(nanoseconds=n).nanoseconds)
    tell("clock", lambda: Time(clock_type=1))
    tell("positional", lambda: Time(1))


def time_text() -> None:
    """Text of times."""
    for kind in (ClockType.ROS_TIME, ClockType.SYSTEM_TIME, ClockType.STEADY_TIME):
        print(
            repr(Time(seconds=1, clock_type=kind)),
            str(Time(clock_type=kind)),
            Time(clock_type=kind).clock_type,
        )
    print(Time(seconds=1.5).seconds_nanoseconds())


def time_arithmetic() -> None:
    """Operators of times."""
    one, two, span = Time(seconds=1), Time(seconds=2), Duration(seconds=1)
    ros = Time(seconds=1, clock_type=ClockType.ROS_TIME)
    for label, call in (
        ("add duration", lambda: one + span),
        ("duration and time", lambda: span + one),
        ("subtract duration", lambda: two - span),
        ("subtract time", lambda: two - one),
        ("negative", lambda: one - Duration(seconds=2)),
        ("negative duration", lambda: one - two),
        ("other clock", lambda: one - ros),
        ("add time", lambda: one + two),
        ("add number", lambda: one + 1),
        ("subtract number", lambda: one - 1),
        ("duration minus time", lambda: span - one),
        ("overflow", lambda: one + Infinite),
    ):
        tell(label, call)
        tell(label, call)


def time_comparison() -> None:
    """Comparison and hash."""
    one, two = Time(seconds=1), Time(seconds=2)
    ros = Time(seconds=1, clock_type=ClockType.ROS_TIME)
    print(one < two, one <= two, one > two, one >= two, one == two, one != two)
    for name in ("__eq__", "__ne__", "__lt__", "__le__", "__gt__", "__ge__"):
        tell(name, lambda n=name: getattr(one, n)(ros))
    tell("number", lambda: one < 1)
    print(one == 1, one != 1, one is None, one == Duration(seconds=1))
    tell("message", lambda: one == TimeMessage(sec=1))
    tell("hash", lambda: bool(hash(one)) or True)
    tell("set", lambda: len({one, two}))


def time_messages() -> None:
    """Conversion to messages."""
    for each in (Time(seconds=1.5), Time(nanoseconds=2**63 - 1)):
        tell(repr(each.nanoseconds), each.to_msg)
    tell("from", lambda: Time.from_msg(TimeMessage(sec=1, nanosec=5)))
    tell("clock", lambda: Time.from_msg(TimeMessage(), clock_type=ClockType.SYSTEM_TIME).clock_type)
    tell("from duration", lambda: Time.from_msg(DurationMessage(sec=1)))


def clock_types() -> None:
    """Enumerations of clocks."""
    for each in (*ClockType.__members__.values(), *ClockChange.__members__.values()):
        print(str(each), int(each), each.name)
    print(ClockType(1), ClockType.ROS_TIME == 1)
    tell("wrong", ClockType, 9)


def clocks() -> None:
    """Clocks by type."""
    for kind in (ClockType.ROS_TIME, ClockType.SYSTEM_TIME, ClockType.STEADY_TIME):
        clock = Clock(clock_type=kind)
        now = clock.now()
        print(type(clock).__name__, clock.clock_type, now.clock_type, clock.now() >= now)
        print(public(clock))
    tell("number", lambda: type(Clock(clock_type=1)).__name__)
    tell("text", lambda: Clock(clock_type="ros"))
    print(repr(ROSClock()) != "", builtins.isinstance(ROSClock(), Clock))


def clock_override() -> None:
    """A ROS clock that is set by hand."""
    clock = ROSClock()
    print(clock.ros_time_is_active)
    clock._set_ros_time_is_active(True)
    clock.set_ros_time_override(Time(seconds=5, clock_type=ClockType.ROS_TIME))
    print(clock.ros_time_is_active, clock.now())
    tell("number", clock.set_ros_time_override, 5)
    clock._set_ros_time_is_active(False)
    print(clock.now().nanoseconds > 10**18)


def jump_thresholds() -> None:
    """Thresholds are checked."""
    for options in (
        {"min_forward": None, "min_backward": None},
        {"min_forward": Duration(seconds=1), "min_backward": Duration(seconds=-1)},
        {"min_forward": Duration(seconds=-1), "min_backward": None},
        {"min_forward": None, "min_backward": Duration(seconds=1)},
        {"min_forward": Duration(), "min_backward": None},
        {"min_forward": None, "min_backward": Duration()},
        {"min_forward": None, "min_backward": None, "on_clock_change": False},
        {"min_forward": 1, "min_backward": None},
    ):
        tell(options, lambda o=options: JumpThreshold(**o))


def jump_callbacks() -> None:
    """Callbacks of jumps."""
    clock = ROSClock()
    told: list[str] = []
    threshold = JumpThreshold(min_forward=Duration(seconds=1), min_backward=Duration(seconds=-1))
    handler = clock.create_jump_callback(
        threshold,
        pre_callback=lambda: told.append("before"),
        post_callback=lambda jump: told.append(f"{jump.clock_change} {jump.delta.nanoseconds}"[:60]),
    )
    clock._set_ros_time_is_active(True)
    for seconds in (10, 10.5, 20, 5):
        clock.set_ros_time_override(Time(seconds=seconds, clock_type=ClockType.ROS_TIME))
    clock._set_ros_time_is_active(False)
    for each in told:
        print(each if "1970" not in each else "")
    handler.unregister()
    clock._set_ros_time_is_active(True)
    print(len(told))
    tell("no callback", clock.create_jump_callback, threshold)


def simulated_time() -> None:
    """A node follows /clock."""
    from rclpy.parameter import Parameter

    with node(parameter_overrides=[Parameter("use_sim_time", value=True)]) as made, spinner(made) as spin:
        print(made.get_clock().now(), made.get_clock().ros_time_is_active)
        publisher = made.create_publisher(ClockMessage, "/clock", 10)
        spin(lambda: publisher.get_subscription_count())
        publisher.publish(ClockMessage(clock=TimeMessage(sec=42)))
        spin(lambda: made.get_clock().now().nanoseconds)
        print(made.get_clock().now())


def simulated_timers() -> None:
    """Timers follow /clock."""
    from rclpy.parameter import Parameter

    with node(parameter_overrides=[Parameter("use_sim_time", value=True)]) as made, spinner(made) as spin:
        told: list[int] = []
        publisher = made.create_publisher(ClockMessage, "/clock", 10)
        made.create_timer(1.0, lambda: told.append(made.get_clock().now().nanoseconds // 10**9))
        spin(lambda: publisher.get_subscription_count())
        for seconds in (10, 11, 12):
            publisher.publish(ClockMessage(clock=TimeMessage(sec=seconds)))
            spin(lambda s=seconds: made.get_clock().now().nanoseconds == s * 10**9)
            spin(seconds=0.1)
        print(told)


def sleep() -> None:
    """Sleeping on a clock."""
    with node() as made:
        clock = made.get_clock()
        print(clock.sleep_for(Duration(seconds=0.05)))
        print(
            clock.sleep_until(clock.now() + Duration(seconds=0.05)),
            clock.sleep_until(Time(clock_type=ClockType.ROS_TIME)),
        )
        tell("other clock", clock.sleep_until, Time(seconds=1, clock_type=ClockType.STEADY_TIME))
        tell("number", clock.sleep_for, 1)
        rclpy.shutdown()
        tell("after shutdown", clock.sleep_for, Duration(seconds=0.05))


def time_is_immutable() -> None:
    """Attributes of times and durations."""
    print(public(Time()), public(Duration()))
    tell("set", lambda: setattr(Time(), "nanoseconds", 1))
    tell("other", lambda: setattr(Duration(), "other", 1))


def copies() -> None:
    """Copies and pickles."""
    import copy

    for each in (Duration(seconds=1), Time(seconds=1)):
        same: Any = copy.copy(each)
        print(same == each)
        tell("deep copy", lambda e=each: copy.deepcopy(e) == e)


def jumps_of_simulated_time() -> None:
    """A node that follows /clock: jumps forward, backward, and the switch."""
    from rclpy.parameter import Parameter

    with node() as made, spinner(made) as spin:
        told: list[Any] = []
        clock = made.get_clock()
        publisher = made.create_publisher(ClockMessage, "/clock", 10)
        handle = clock.create_jump_callback(
            JumpThreshold(min_forward=Duration(seconds=5), min_backward=Duration(seconds=-2)),
            pre_callback=lambda: told.append("before"),
            post_callback=lambda jump: told.append((int(jump.clock_change), jump.delta.nanoseconds // 10**9)),
        )
        made.set_parameters([Parameter("use_sim_time", value=True)])
        spin(publisher.get_subscription_count)
        print([each if isinstance(each, str) else each[0] for each in told], clock.ros_time_is_active)
        told.clear()
        for seconds in (10, 12, 30, 29, 20):
            publisher.publish(ClockMessage(clock=TimeMessage(sec=seconds)))
            spin(lambda s=seconds: clock.now().nanoseconds == s * 10**9)
        print(told)
        told.clear()
        made.set_parameters([Parameter("use_sim_time", value=False)])
        spin(seconds=0.1)
        print([each if isinstance(each, str) else each[0] for each in told], clock.ros_time_is_active)
        handle.unregister()
        tell("again", handle.unregister)


def timers_of_jumps() -> None:
    """Timers of a simulated clock: a large jump calls once, a jump backward restarts the period."""
    from rclpy.parameter import Parameter

    with node(parameter_overrides=[Parameter("use_sim_time", value=True)]) as made, spinner(made) as spin:
        calls: list[int] = []
        publisher = made.create_publisher(ClockMessage, "/clock", 10)
        spin(publisher.get_subscription_count)

        def tick(seconds: float) -> None:
            message = ClockMessage(clock=TimeMessage(sec=int(seconds), nanosec=int(seconds % 1 * 1e9)))
            publisher.publish(message)
            spin(lambda: abs(made.get_clock().now().nanoseconds - seconds * 1e9) < 1000)
            spin(seconds=0.06)

        tick(100)
        timer = made.create_timer(1.0, lambda: calls.append(made.get_clock().now().nanoseconds // 10**8))
        for seconds in (100.5, 101, 110, 110.5, 111.5, 50, 50.5, 51.5):
            tick(seconds)
            print(seconds, calls, round(timer.time_until_next_call() / 1e8))


def sleep_with_simulated_time() -> None:
    """Sleeping until a simulated time, which another thread publishes."""
    import threading

    from rclpy.parameter import Parameter

    with node(parameter_overrides=[Parameter("use_sim_time", value=True)]) as made, spinner(made) as spin:
        publisher = made.create_publisher(ClockMessage, "/clock", 10)
        clock = made.get_clock()
        spin(publisher.get_subscription_count)
        publisher.publish(ClockMessage(clock=TimeMessage(sec=10)))
        spin(lambda: clock.now().nanoseconds)
        slept: list[bool] = []
        thread = threading.Thread(target=lambda: slept.append(clock.sleep_for(Duration(seconds=5))))
        thread.start()
        for seconds in (12, 14, 16):
            publisher.publish(ClockMessage(clock=TimeMessage(sec=seconds)))
            spin(seconds=0.1)
            print(seconds, slept)
        thread.join()
