"""Nodes like those of the tutorials for beginners: what each writes, receives and returns."""

from typing import Any

import rclpy
from geometry_msgs.msg import PoseStamped, Twist
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    Log,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rclpy.wait_for_message import wait_for_message
from std_msgs.msg import Int32, String
from std_srvs.srv import SetBool, Trigger

from differential.steps import fails, node, spinner, wait, with_logs


class _Counter(Node):
    """Publishes numbers by a timer."""

    def __init__(self, **options: Any) -> None:
        super().__init__("counter", **options)
        self.number = 0
        self.numbers = self.create_publisher(Int32, "numbers", 10)
        self.ticks = self.create_timer(0.02, self.tick)

    def tick(self) -> None:
        self.numbers.publish(Int32(data=self.number))
        self.get_logger().info(f"sent {self.number}", once=True)
        self.number += 1


@with_logs
def class_with_a_timer() -> None:
    """A class that publishes, and one that adds up."""
    rclpy.init()
    counter, adder = _Counter(), Node("adder")
    sums: list[int] = []
    adder.create_subscription(Int32, "numbers", lambda m: sums.append(m.data + sum(sums[-1:])), 10)
    with spinner(counter, adder) as spin:
        print(spin(lambda: len(sums) >= 5), sums == sorted(sums))
    counter.ticks.cancel()
    print(counter.ticks.is_canceled(), counter.get_name(), [each.topic_name for each in counter.publishers])
    adder.destroy_node()
    counter.destroy_node()
    rclpy.shutdown()


def service_with_a_client_class() -> None:
    """A switch, called by a client that spins until the future is done."""

    class _Switch(Node):
        def __init__(self) -> None:
            super().__init__("switch")
            self.is_on = False
            self.create_service(SetBool, "turn", self.turn)

        def turn(self, request: Any, response: Any) -> Any:
            changed, self.is_on = self.is_on != request.data, request.data
            response.success, response.message = changed, f"on: {self.is_on}"
            return response

    with node("user") as user:
        switch = _Switch()
        client = user.create_client(SetBool, "turn")
        executor = SingleThreadedExecutor()
        executor.add_node(switch)
        executor.add_node(user)
        print(client.wait_for_service(timeout_sec=4.0), client.srv_name, client.service_is_ready())
        for wanted in (True, True, False):
            future = client.call_async(SetBool.Request(data=wanted))
            executor.spin_until_future_complete(future, timeout_sec=4)
            print(future.done(), future.exception(), future.result())
        fails("request", client.call_async, SetBool.Response())
        executor.shutdown()
        switch.destroy_node()


def service_that_nobody_offers() -> None:
    """A client gives up."""
    with node() as made:
        client = made.create_client(Trigger, "missing")
        print(client.wait_for_service(timeout_sec=0.1), client.service_is_ready())
        future = client.call_async(Trigger.Request())
        rclpy.spin_until_future_complete(made, future, timeout_sec=0.1)
        print(future.done(), future.cancelled())
        client.remove_pending_request(future)
        print(made.destroy_client(client), made.destroy_client(client))


def settings_of_a_robot() -> None:
    """Parameters with descriptions and ranges."""
    with node("robot") as made:
        near = IntegerRange(from_value=0, to_value=10, step=2)
        fast = FloatingPointRange(from_value=0.0, to_value=1.0, step=0.0)
        made.declare_parameter("name", "robby", ParameterDescriptor(description="what it is called"))
        made.declare_parameter("near", 4, ParameterDescriptor(integer_range=[near]))
        made.declare_parameter("fast", 0.5, ParameterDescriptor(floating_point_range=[fast]))
        made.declare_parameter("serial", 7, ParameterDescriptor(read_only=True))
        for name, value in (
            ("near", 6),
            ("near", 5),
            ("near", 12),
            ("fast", 1.5),
            ("serial", 8),
            ("name", 1),
        ):
            result = made.set_parameters([Parameter(name, value=value)])[0]
            print(name, value, result.successful, "|", result.reason)
        print([(each.name, each.value) for each in made.get_parameters(["name", "near", "fast", "serial"])])
        fails("outside", made.declare_parameter, "near2", 11, ParameterDescriptor(integer_range=[near]))
        fails("step", made.declare_parameter, "near3", 3, ParameterDescriptor(integer_range=[near]))
        fails("unknown", made.get_parameter, "other")
        fails("twice", made.declare_parameter, "name", "again")


def settings_that_are_watched() -> None:
    """Callbacks before, on and after a change."""
    with node("robot") as made:
        made.declare_parameters("arm", [("speed", 1.0), ("joints", 6), ("tool", "none")])
        seen: list[object] = []

        def before(parameters: list[Parameter]) -> list[Parameter]:
            extra = [Parameter("arm.tool", value="drill")] if parameters[0].name == "arm.joints" else []
            return [*parameters, *extra]

        def check(parameters: list[Parameter]) -> SetParametersResult:
            bad = [each.name for each in parameters if each.name == "arm.speed" and each.value > 2]
            return SetParametersResult(successful=not bad, reason=f"too fast: {bad}" if bad else "")

        made.add_pre_set_parameters_callback(before)
        made.add_on_set_parameters_callback(check)
        made.add_post_set_parameters_callback(lambda each: seen.append([one.name for one in each]))
        for each in (Parameter("arm.speed", value=3.0), Parameter("arm.joints", value=7)):
            print(made.set_parameters([each]))
        print(
            made.set_parameters_atomically(
                [Parameter("arm.joints", value=8), Parameter("arm.speed", value=9.0)]
            )
        )
        print(seen, {name: each.value for name, each in sorted(made.get_parameters_by_prefix("arm").items())})
        made.remove_pre_set_parameters_callback(before)
        fails("again", made.remove_pre_set_parameters_callback, before)


def settings_of_the_command_line() -> None:
    """Values of arguments, with remapped names."""
    arguments = ["--ros-args", "-r", "__node:=lift", "-r", "__ns:=/hall", "-r", "chatter:=/said"]
    arguments += [
        "-p",
        "floors:=5",
        "-p",
        "names:=[a, b]",
        "-p",
        "rate:=2.5",
        "-p",
        "on:=true",
        "-p",
        "lift:speed:=3",
    ]
    rclpy.init(args=arguments)
    made = Node("node", allow_undeclared_parameters=False)
    print(made.get_fully_qualified_name(), made.resolve_topic_name("chatter"))
    for name, default in (("floors", 1), ("names", ["x"]), ("rate", 1.0), ("on", False), ("speed", 0)):
        print(name, made.declare_parameter(name, default).value)
    fails("type", made.declare_parameter, "floors2", Parameter.Type.STRING)
    fails("no value", lambda: made.get_parameter("floors2").value)
    made.destroy_node()
    automatic = Node("other", automatically_declare_parameters_from_overrides=True)
    print(sorted(name for name in automatic.get_parameters_by_prefix("")))
    fails("wrong type", automatic.declare_parameter, "floors", "five")
    automatic.destroy_node()
    rclpy.shutdown()


def latched_map() -> None:
    """A late subscriber receives the last message of a transient local publisher."""
    latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    with node() as made, spinner(made) as spin:
        publisher = made.create_publisher(PoseStamped, "map", latched)
        for x in (1.0, 2.0):
            message = PoseStamped()
            message.header.frame_id = "map"
            message.pose.position.x = x
            publisher.publish(message)
        late: list[Any] = []
        plain: list[Any] = []
        made.create_subscription(PoseStamped, "map", late.append, latched)
        made.create_subscription(PoseStamped, "map", plain.append, 10)
        print(spin(lambda: late), [each.pose.position.x for each in late])
        spin(seconds=0.2)
        print(len(late), len(plain), late[0])


def one_message() -> None:
    """Waiting for a message, and for one that never comes."""
    with node() as made:
        publisher = made.create_publisher(String, "words", QoSProfile(depth=1, durability=1))
        publisher.publish(String(data="hello"))
        print(
            wait_for_message(
                String, made, "words", qos_profile=QoSProfile(depth=1, durability=1), time_to_wait=4
            )
        )
        print(wait_for_message(String, made, "silent", time_to_wait=0.1))
        print(made.count_publishers("words"), made.count_subscribers("words"))


def sensor_and_reliable() -> None:
    """A best effort publisher, a reliable subscription, and their profiles in the graph."""
    with node() as made:
        made.create_publisher(Twist, "speed", qos_profile_sensor_data)
        made.create_subscription(Twist, "speed", print, 10)
        wait(lambda: made.count_publishers("speed") and made.count_subscribers("speed"))
        for each in (
            *made.get_publishers_info_by_topic("speed"),
            *made.get_subscriptions_info_by_topic("speed"),
        ):
            profile = each.qos_profile
            print(each.node_name, each.topic_type, each.endpoint_type.name)
            print(profile.reliability.name, profile.durability.name, profile.lifespan, profile.deadline)


@with_logs
def log_of_a_node_without_rosout() -> None:
    """--disable-rosout-logs: no publisher, and no topic in the graph."""
    for argument in ("--disable-rosout-logs", "--enable-rosout-logs"):
        rclpy.init(args=["--ros-args", argument])
        made = Node("quiet")
        wait(lambda n=made: n.count_publishers("/rosout"), 0.5)
        made.get_logger().warning("a warning")
        topics = [name for name, _ in made.get_topic_names_and_types()]
        print(
            argument,
            "/rosout" in topics,
            made.count_publishers("/rosout"),
            [each.topic for each in made.publishers],
        )
        made.destroy_node()
        rclpy.shutdown()


def log_that_is_received() -> None:
    """Lines of a node on /rosout, with its name and severity."""
    with node("speaker", namespace="/hall") as made, spinner(made) as spin:
        lines: list[Any] = []
        made.create_subscription(Log, "/rosout", lines.append, 10)
        wait(lambda: made.count_subscribers("/rosout"))
        spin(seconds=0.3)
        made.get_logger().error("broken")
        made.get_logger().info("fine")
        spin(lambda: len(lines) >= 2)
        print([(each.name, each.level, each.msg) for each in lines])


def types_of_parameters() -> None:
    """Declaration by type, dynamic typing, and undeclaring."""
    with node() as made:
        made.declare_parameter("speed", Parameter.Type.DOUBLE)
        fails("speed", lambda: made.get_parameter("speed").value)
        print(made.get_parameter_or("speed", Parameter("speed", value=0.1)).value)
        print(made.set_parameters([Parameter("speed", value=1)])[0].successful)
        made.declare_parameter("any", None, ParameterDescriptor(dynamic_typing=True))
        for value in (1, "one", [1.5], None):
            result = made.set_parameters([Parameter("any", value=value)])[0]
            print(value, result.successful, result.reason, made.get_parameter("any").type_.name)
        print(
            made.describe_parameter("speed").type == ParameterType.PARAMETER_DOUBLE, made.has_parameter("any")
        )
        fails("undeclare", made.undeclare_parameter, "any")
        fails("undeclare", made.undeclare_parameter, "speed")
        fails("mixed", Parameter, "a", value=[1, "b"])
        fails("type", Parameter, "a", Parameter.Type.STRING, 1)


@with_logs
def program_that_is_interrupted() -> None:
    """`try: spin` with what a shutdown raises."""
    rclpy.init()
    made = Node("main")
    made.create_timer(0.05, lambda: rclpy.shutdown())
    try:
        rclpy.spin(made)
        print("returned")
    except ExternalShutdownException as error:
        print("shut down", repr(str(error)))
    print(rclpy.ok(), rclpy.try_shutdown())
    fails("publish", lambda: made.create_publisher(String, "late", 10).publish(String()))
    fails("shutdown", rclpy.shutdown)
