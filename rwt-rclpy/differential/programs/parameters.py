"""Parameters of nodes, their services and clients, and values on the command line and in files."""

import tempfile
from typing import Any

import rclpy
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    ParameterValue,
    SetParametersResult,
)
from rclpy.parameter import Parameter, parameter_value_to_python

from differential.steps import node, public, spinner, tell


def declare_and_get() -> None:
    """Values of every type."""
    with node() as made:
        values = (True, 1, 1.5, "a", b"a", [True], [1, 2], [1.5], ["a", "b"], [b"a"], [], None)
        for number, value in enumerate(values):
            parameter = tell(value, made.declare_parameter, f"p{number}", value)
            if parameter is not None:
                print(parameter.type_, repr(parameter.value))


def declare_by_type() -> None:
    """Parameters without a value."""
    with node() as made:
        for kind in Parameter.Type:
            parameter = tell(kind.name, made.declare_parameter, f"p{kind.value}", kind)
            if parameter is not None:
                tell("get", lambda k=kind: made.get_parameter(f"p{k.value}").value)


def declare_mixed_arrays() -> None:
    """Arrays of several types."""
    with node() as made:
        for number, value in enumerate(
            ([1, 2.5], [1, "a"], [True, 1], (1, 2), {"a": 1}, {1, 2}, 1 + 2j, [[1]], 2**63)
        ):
            tell(value, made.declare_parameter, f"p{number}", value)


def declare_twice() -> None:
    """Declaration, removal, and access without declaration."""
    with node() as made:
        made.declare_parameter("a", 1)
        tell("again", made.declare_parameter, "a", 1)
        tell("get", made.get_parameter, "b")
        tell("set", made.set_parameters, [Parameter("b", value=1)])
        tell("undeclare", made.undeclare_parameter, "b")
        tell("describe", made.describe_parameter, "b")
        made.undeclare_parameter("a")
        print(made.has_parameter("a"))
        print(made.get_parameter_or("a", Parameter("a", value=4)).value)
        print(made.get_parameter_or("a").type_)


def undeclared_allowed() -> None:
    """Nodes that allow undeclared parameters."""
    with node(allow_undeclared_parameters=True) as made:
        print(made.get_parameter("a").type_, made.get_parameter("a").value)
        print(made.set_parameters([Parameter("a", value=1)]))
        print(made.get_parameter("a").value, made.has_parameter("a"))
        print(made.set_parameters([Parameter("a")]), made.has_parameter("a"))


def types_are_fixed() -> None:
    """Another type is rejected unless the descriptor allows it."""
    with node() as made:
        made.declare_parameter("a", 1)
        print(made.set_parameters([Parameter("a", value="text")]))
        print(made.set_parameters([Parameter("a")]))
        made.declare_parameter("b", 1, ParameterDescriptor(dynamic_typing=True))
        print(made.set_parameters([Parameter("b", value="text")]))
        tell(
            "default",
            made.declare_parameter,
            "c",
            1,
            ParameterDescriptor(type=ParameterType.PARAMETER_STRING),
        )


def read_only() -> None:
    """Read-only parameters."""
    with node() as made:
        made.declare_parameter("a", 1, ParameterDescriptor(read_only=True))
        print(made.set_parameters([Parameter("a", value=2)]), made.get_parameter("a").value)
        tell("undeclare", made.undeclare_parameter, "a")


def integer_ranges() -> None:
    """Ranges of integers."""
    with node() as made:
        span = IntegerRange(from_value=0, to_value=10, step=2)
        made.declare_parameter("a", 4, ParameterDescriptor(integer_range=[span]))
        for value in (0, 2, 3, 10, 12, -2):
            print(value, made.set_parameters([Parameter("a", value=value)]))
        tell("default", made.declare_parameter, "b", 3, ParameterDescriptor(integer_range=[span]))


def floating_point_ranges() -> None:
    """Ranges of floating-point numbers."""
    with node() as made:
        span = FloatingPointRange(from_value=0.0, to_value=1.0, step=0.25)
        made.declare_parameter("a", 0.5, ParameterDescriptor(floating_point_range=[span]))
        for value in (0.0, 0.25, 0.3, 1.0, 1.25, 0.2500000001):
            print(value, made.set_parameters([Parameter("a", value=value)]))


def on_set_callbacks() -> None:
    """Callbacks that accept, reject, return nothing, raise."""
    with node() as made:
        made.declare_parameter("a", 1)
        for label, callback in (
            ("accepts", lambda p: SetParametersResult(successful=True)),
            ("rejects", lambda p: SetParametersResult(successful=False, reason="no")),
            ("nothing", lambda p: None),
            ("raises", lambda p: [][1]),
        ):
            made.add_on_set_parameters_callback(callback)
            tell(label, made.set_parameters, [Parameter("a", value=2)])
            tell("remove", made.remove_on_set_parameters_callback, callback)
        print(made.get_parameter("a").value)
        tell("remove again", made.remove_on_set_parameters_callback, callback)


def pre_and_post_set_callbacks() -> None:
    """Callbacks before and after."""
    with node() as made:
        made.declare_parameter("a", 1)
        made.declare_parameter("b", 1)
        made.add_pre_set_parameters_callback(lambda given: [*given, Parameter("b", value=5)])
        made.add_post_set_parameters_callback(lambda given: print("set", sorted(each.name for each in given)))
        print(made.set_parameters([Parameter("a", value=3)]))
        print(made.get_parameter("a").value, made.get_parameter("b").value)


def pre_set_returns_nothing() -> None:
    """A callback before that returns nothing or an empty list."""
    with node() as made:
        made.declare_parameter("a", 1)
        for value in ([], None):

            def callback(given: object, value: object = value) -> object:
                return value

            made.add_pre_set_parameters_callback(callback)
            tell(value, made.set_parameters, [Parameter("a", value=3)])
            made.remove_pre_set_parameters_callback(callback)


def atomically() -> None:
    """All or none."""
    with node() as made:
        made.declare_parameter("a", 1)
        made.declare_parameter("b", 1)
        print(made.set_parameters_atomically([Parameter("a", value=2), Parameter("b", value="text")]))
        print(made.get_parameter("a").value)
        print(made.set_parameters_atomically([Parameter("a", value=2), Parameter("b", value=3)]))
        tell("undeclared", made.set_parameters_atomically, [Parameter("a", value=4), Parameter("c", value=3)])
        print(made.get_parameter("a").value)


def overrides() -> None:
    """Overrides of the constructor."""
    with node(parameter_overrides=[Parameter("a", value=5), Parameter("b", value="text")]) as made:
        print(made.declare_parameter("a", 1).value)
        tell("other type", made.declare_parameter, "b", 1)
        print(made.declare_parameter("c", 1, ignore_override=True).value)


def declared_from_overrides() -> None:
    """Overrides are declared automatically."""
    with node(
        parameter_overrides=[Parameter("a", value=5)], automatically_declare_parameters_from_overrides=True
    ) as made:
        print(made.get_parameter("a").value)
        tell("again", made.declare_parameter, "a", 1)


def declare_several() -> None:
    """Several at once, in a namespace."""
    with node() as made:
        declared = made.declare_parameters("ns", [("a", 1), ("b", "x", ParameterDescriptor()), ("c",)])
        print([(each.name, each.value) for each in declared])
        tell("wrong", made.declare_parameters, "ns", [("a",)])
        tell("not text", made.declare_parameters, "ns", [(1, 2)])
        for prefix in ("ns", "", "other"):
            print(prefix, sorted(made.get_parameters_by_prefix(prefix)))


def names() -> None:
    """Names of parameters."""
    with node() as made:
        for name in ("a", "a.b", "a/b", "1a", "a b", "", "ä", "a-b", ".a", "a.", "a..b", "_a"):
            tell(repr(name), made.declare_parameter, name, 1)


def default_parameters() -> None:
    """Parameters that every node has."""
    with node() as made:
        print(sorted(made._parameters))
        print(made.get_parameter("use_sim_time"))
        print(made.describe_parameter("use_sim_time"))
        print(made.get_parameter_types(["use_sim_time"]))


def descriptors() -> None:
    """Descriptors."""
    with node() as made:
        made.declare_parameter("a", 1, ParameterDescriptor(description="text"))
        print(made.describe_parameter("a"))
        print(made.set_descriptor("a", ParameterDescriptor(description="other")).value)
        print(made.describe_parameters(["a"]))


def parameter_class() -> None:
    """The class Parameter."""
    print(Parameter("a", value=1), repr(Parameter("a", Parameter.Type.STRING, "x")))
    print(Parameter("a").type_, Parameter("a").value)
    print(Parameter.Type, Parameter.Type.__name__, list(Parameter.Type))
    print(public(Parameter("a")), public(Parameter.Type.BOOL)[:4])
    tell("type", Parameter, "a", Parameter.Type.INTEGER, "x")
    tell("unknown", Parameter, "a", value=object())
    tell("no type", Parameter, "a", "INTEGER", 1)
    print(Parameter("a", value=1) == Parameter("a", value=1))
    print(Parameter("a", value=[1]).to_parameter_msg())
    print(Parameter.from_parameter_msg(Parameter("a", value="x").to_parameter_msg()).value)
    print(
        Parameter.Type.from_parameter_value([1.5]),
        Parameter.Type.INTEGER.check(1),
        Parameter.Type.INTEGER.check("1"),
    )


def parameter_values() -> None:
    """Messages with values."""
    for value in (1, 1.5, "x", True, [1], [], ["x"]):
        message = Parameter("a", value=value).get_parameter_value()
        print(message.type, parameter_value_to_python(message))
    tell("unknown", parameter_value_to_python, ParameterValue(type=50))
    print(rclpy.parameter.get_parameter_value("1.5"), rclpy.parameter.get_parameter_value("[1, 2]"))


VALUES = (
    "1", "-1", "+1", "1.5", "-1.5", ".5", "5.", "1e3", "1e-3", "1E3", "1_000", "0x1F", "0b11", "0o17",
    "017", "08",
    "1:30", "1:30.5", "true", "True", "TRUE", "tRue", "false", "yes", "Yes", "no", "on", "On", "off",
    "y", "Y", "n",
    "N", "=", "<<", "~", "null", "Null", "NULL", "", "''", '""', "'1'", '"1"', '"true"', ".inf",
    "-.inf", ".Inf",
    ".nan", ".NaN", "inf", "nan", "2020-01-01", "2020-01-01T00:00:00Z", "a", "a b", "a: b", "[]", "[1, 2]",
    "[1, 2.5]", "[1, a]", "[true, false]", "[a, b]", "['1', '2']", "[1.5]", "[[1]]", "{}", "{a: 1}",
    "!!str 1",
    "!!int 1", "!!int '1'", "!!float 1", "!!bool yes", "!!binary aGVsbG8=", "!!null x", "&a 1", "*a",
    "- 1", "%", "@",
    "`", "|", ">", "9223372036854775807", "9223372036854775808", "-9223372036854775808", "1e400", "0x",
    "0x1G",
    "1.2.3", "++1", "1 ", " 1", "#a", "a#b", "a #b", "ä", "\\", "'a''b'", '"a\\nb"', "[1, ", "{", "'",
    "[~]",
    "[null, 1]", "[1, true]", "[yes, no]", "[1, 1.0]", "[1, '2']",
)  # fmt: skip


def command_line_values() -> None:
    """Values after -p, by the rules of rcl's YAML."""
    for text in VALUES:
        try:
            rclpy.init(args=["--ros-args", "-p", f"p:={text}"])
        except Exception as error:
            print(repr(text), "init raises", type(error).__name__)
            continue
        try:
            made = rclpy.create_node("node", start_parameter_services=False, enable_rosout=False)
        except Exception as error:
            print(repr(text), "node raises", type(error).__name__)
        else:
            overrides = made._parameter_overrides
            print(repr(text), {name: (each.type_.name, each.value) for name, each in overrides.items()})
        rclpy.try_shutdown()


FILES = (
    "node:\n  ros__parameters:\n    a: 1\n    b:\n      c: x\n      d: [1, 2]\n",
    "/**:\n  ros__parameters:\n    a: 1\nnode:\n  ros__parameters:\n    a: 2\n",
    "node:\n  ros__parameters:\n    a: 2\n/**:\n  ros__parameters:\n    a: 1\n",
    "/ns:\n  node:\n    ros__parameters:\n      a: 3\n",
    "/ns/node:\n  ros__parameters:\n    a: 3\n",
    "/*/node:\n  ros__parameters:\n    a: 3\n",
    "/*:\n  ros__parameters:\n    a: 3\n",
    "other:\n  ros__parameters:\n    a: 3\n",
    "node:\n  a: 1\n",
    "node:\n",
    "node: 1\n",
    "",
    "- 1\n",
    "node:\n  ros__parameters:\n",
    "node:\n  ros__parameters:\n    a: {}\n",
    "node:\n  ros__parameters:\n    a: [1, x]\n",
    "node:\n  ros__parameters:\n    a: [[1]]\n",
    "node:\n  ros__parameters:\n    a: ~\n",
    "node:\n  ros__parameters:\n    a: 2020-01-01\n    b: 1_000\n    c: 1:30\n",
    "node:\n  ros__parameters:\n    d: 0o17\n    e: y\n    f: =\n",
    "node:\n  ros__parameters:\n    a: !!str 1\n    b: !!binary aGVsbG8=\n",
    "node:\n  ros__parameters:\n    a: 1\n    a: 2\n",
    "node:\n  ros__parameters:\n    ? a\n    : 1\n",
    "node:\n  ros__parameters:\n    a: &x 1\n    b: *x\n",
    "node:\n  ros__parameters:\n    1: 2\n",
    "node:\n  ros__parameters:\n    a.b: 2\n    a/b: 3\n",
    "node:\n  ros__parameters:\n    a: |\n      text\n      more\n",
    "node:\n\tros__parameters: 1\n",
    "a: [",
    "ros__parameters:\n  a: 1\n",
    "/**:\n  ros__parameters:\n    a: 1\n---\nnode:\n  ros__parameters:\n    a: 2\n",
    "node:\n  ros__parameters:\n    a: [1, 2.5]\n    b: [1.0, 2]\n    c: [true, 1]\n",
    "node:\n  ros__parameters:\n    a: '1'\n    b: \"true\"\n    c: [ '1' ]\n",
    "node:\n  ros__parameters:\n    a: 1e3\n    b: .5\n    c: 5.\n    d: 0x10\n    e: +1\n    f: 1e400\n",
    "node:\n  ros__parameters:\n    qos_overrides:\n      /topic:\n        publisher:\n          depth: 3\n",
    "node:\n  ros__parameters:\n    a: [1:30]\n",
    "node:\n  ros__parameters:\n    a: ['1:30']\n    b: 1:30\n",
    "node:\n  ros__parameters: {a: b:c}\n",
)


def files() -> None:
    """Files of parameters."""
    for number, text in enumerate(FILES):
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
            file.write(text)
            file.flush()
            try:
                rclpy.init(args=["--ros-args", "--params-file", file.name])
            except Exception as error:
                print(number, "init raises", type(error).__name__)
                continue
            try:
                options = {"namespace": "ns"} if "/ns" in text or "/*" in text else {}
                made = rclpy.create_node(
                    "node", start_parameter_services=False, enable_rosout=False, **options
                )
            except Exception as error:
                print(number, "node raises", type(error).__name__)
            else:
                found = made._parameter_overrides.items()
                print(number, {name: (each.type_.name, each.value) for name, each in sorted(found)})
            rclpy.try_shutdown()


def file_missing() -> None:
    """A file that does not exist."""
    tell("init", rclpy.init, args=["--ros-args", "--params-file", "/nowhere.yaml"])


def command_line_of_nodes() -> None:
    """Values for one node, and order."""
    arguments = ["--ros-args", "-p", "a:=1", "-p", "node:a:=2", "-p", "other:b:=3", "-p", "a:=4"]
    with node(args=arguments) as made:
        print({name: each.value for name, each in made._parameter_overrides.items()})


def services_of_a_node() -> None:
    """The parameter services."""
    from rcl_interfaces.srv import (
        DescribeParameters,
        GetParameters,
        GetParameterTypes,
        ListParameters,
        SetParameters,
    )

    with node() as made, spinner(made) as spin:
        made.declare_parameter("a.b", 1)
        made.declare_parameter("a.c.d", "x")

        def call(kind: Any, name: str, request: Any) -> None:
            client = made.create_client(kind, f"node/{name}")
            client.wait_for_service(5)
            future = client.call_async(request)
            spin(future.done)
            print(name, future.result())

        call(GetParameters, "get_parameters", GetParameters.Request(names=["a.b", "none"]))
        call(GetParameters, "get_parameters", GetParameters.Request(names=["a.b"]))
        call(GetParameterTypes, "get_parameter_types", GetParameterTypes.Request(names=["a.b", "a.c.d"]))
        call(DescribeParameters, "describe_parameters", DescribeParameters.Request(names=["a.b"]))
        for depth in (0, 1, 2, 3):
            call(ListParameters, "list_parameters", ListParameters.Request(prefixes=["a"], depth=depth))
        call(ListParameters, "list_parameters", ListParameters.Request(prefixes=["none"]))
        for parameter in (Parameter("a.b", value=2), Parameter("a.b", value="x"), Parameter("new", value=1)):
            request = SetParameters.Request(parameters=[parameter.to_parameter_msg()])
            call(SetParameters, "set_parameters", request)


def client() -> None:
    """The asynchronous parameter client."""
    from rclpy.parameter_client import AsyncParameterClient

    with node() as made, spinner(made) as spin:
        made.declare_parameter("a", 1)
        other = AsyncParameterClient(made, "node")
        print(other.wait_for_services(5), other.services_are_ready())
        for future in (
            other.get_parameters(["a"]),
            other.set_parameters([Parameter("a", value=2)]),
            other.list_parameters(["a"], 1),
            other.describe_parameters(["a"]),
            other.get_parameter_types(["a"]),
            other.delete_parameters(["a"]),
        ):
            spin(future.done)
            print(future.result())


def events() -> None:
    """Parameter events."""
    from rcl_interfaces.msg import ParameterEvent

    with node() as made, spinner(made) as spin:
        told: list[Any] = []
        made.create_subscription(ParameterEvent, "/parameter_events", told.append, 10)
        spin(seconds=0.2)
        made.declare_parameter("a", 1)
        made.set_parameters([Parameter("a", value=2)])
        made.undeclare_parameter("a")
        spin(lambda: len(told) == 3, 2)
        for event in told:
            print(
                event.node,
                [each.name for each in event.new_parameters],
                [(each.name, each.value.integer_value) for each in event.changed_parameters],
                [each.name for each in event.deleted_parameters],
            )


def event_handler() -> None:
    """The handler of parameter events."""
    from rclpy.parameter_event_handler import ParameterEventHandler

    with node() as made, spinner(made) as spin:
        told: list[Any] = []
        made.declare_parameter("a", 1)
        handler = ParameterEventHandler(made)
        handle = handler.add_parameter_callback("a", "node", lambda p: told.append(p.value.integer_value))
        spin(seconds=0.2)
        made.set_parameters([Parameter("a", value=2)])
        spin(lambda: told, 2)
        handler.remove_parameter_callback(handle)
        made.set_parameters([Parameter("a", value=3)])
        spin(seconds=0.2)
        print(told)


def use_sim_time() -> None:
    """The parameter that selects the clock."""
    with node() as made:
        print(made.set_parameters([Parameter("use_sim_time", value=True)]))
        print(made.get_clock().ros_time_is_active, made.get_clock().now().nanoseconds)
        print(made.set_parameters([Parameter("use_sim_time", value=1)]))
        print(
            made.set_parameters([Parameter("use_sim_time", value=False)]), made.get_clock().ros_time_is_active
        )


def descriptors_of_types() -> None:
    """Declarations whose value, type and descriptor do not fit each other."""
    with node() as made:
        for number, (value, options) in enumerate(
            (
                (None, {}),
                (None, {"dynamic_typing": True}),
                (None, {"type": ParameterType.PARAMETER_STRING}),
                (1, {"type": ParameterType.PARAMETER_STRING}),
                (1, {"dynamic_typing": True, "type": ParameterType.PARAMETER_STRING}),
                ("a", {"read_only": True, "description": "text", "additional_constraints": "none"}),
                (5, {"integer_range": [IntegerRange(from_value=0, to_value=10, step=5)]}),
                (4, {"integer_range": [IntegerRange(from_value=0, to_value=10, step=5)]}),
                (10, {"integer_range": [IntegerRange(from_value=0, to_value=10, step=3)]}),
                (5.0, {"integer_range": [IntegerRange(from_value=0, to_value=10)]}),
                (5, {"floating_point_range": [FloatingPointRange(from_value=0.0, to_value=10.0)]}),
                (0.3, {"floating_point_range": [FloatingPointRange(from_value=0.0, to_value=1.0, step=0.1)]}),
                ("a", {"integer_range": [IntegerRange(from_value=0, to_value=1)]}),
            )
        ):
            name = f"p{number}"
            tell(
                (value, sorted(options)), made.declare_parameter, name, value, ParameterDescriptor(**options)
            )
            tell("descriptor", lambda n=name: str(made.describe_parameter(n)))
            tell("value", lambda n=name: made.get_parameter(n).value)


def ranges_of_set_parameters() -> None:
    """Values within and beyond a range, and the reasons."""
    with node() as made:
        made.declare_parameter(
            "i", 5, ParameterDescriptor(integer_range=[IntegerRange(from_value=0, to_value=10, step=5)])
        )
        made.declare_parameter(
            "f",
            0.5,
            ParameterDescriptor(floating_point_range=[FloatingPointRange(from_value=-1.0, to_value=1.0)]),
        )
        for name, value in (("i", 10), ("i", 7), ("i", 11), ("i", 1.0), ("f", 1.0), ("f", 1.1), ("f", 1)):
            (result,) = made.set_parameters([Parameter(name, value=value)])
            print(name, value, result.successful, made.get_parameter(name).value)


def set_descriptor() -> None:
    """Descriptors that are changed."""
    with node() as made:
        made.declare_parameter("a", 5)
        made.declare_parameter("read", 5, ParameterDescriptor(read_only=True))
        described = ParameterDescriptor(description="new", integer_range=[IntegerRange(to_value=10)])
        tell("set", lambda: made.set_descriptor("a", described).value)
        print(made.describe_parameter("a"))
        tell(
            "with value",
            lambda: made.set_descriptor("a", described, Parameter("a", value=3).get_parameter_value()),
        )
        print(made.get_parameter("a").value)
        tell("read only", made.set_descriptor, "read", described)
        tell("undeclared", made.set_descriptor, "b", described)
        tell(
            "out of range",
            made.set_descriptor,
            "a",
            ParameterDescriptor(integer_range=[IntegerRange(from_value=8, to_value=10)]),
        )
        print(made.get_parameter("a").value)


def overrides_of_other_types() -> None:
    """Values of the command line whose type is not that of the declaration."""
    for text in (
        "1",
        "1.0",
        "true",
        "text",
        "[1, 2]",
        "[1.0, 2]",
        "[]",
        "[a, 1]",
        "'1'",
        "1e3",
        ".inf",
        "''",
    ):
        with node(args=["--ros-args", "-p", f"p:={text}"]) as made:
            for number, value in enumerate((1, 1.5, "a", True, [1], [1.5], ["a"])):
                tell(
                    (text, value),
                    lambda v=value: made.declare_parameter("p", v, ignore_override=False).value,
                )
                if made.has_parameter("p"):
                    made.undeclare_parameter("p")
                tell("ignored", lambda v=value, n=number: made.declare_parameter(f"q{n}", v).value)


def callbacks_in_order() -> None:
    """Several callbacks of each kind, one of which rejects."""
    with node() as made:
        told: list[str] = []

        def before(parameters: Any) -> Any:
            told.append("before")
            return [*parameters, Parameter("b", value=2)]

        def check(name: str, accepts: bool) -> Any:
            def callback(parameters: Any) -> Any:
                told.append(f"{name} {[each.name for each in parameters]}")
                return SetParametersResult(successful=accepts, reason=name)

            return callback

        made.declare_parameter("a", 0)
        made.declare_parameter("b", 0)
        made.add_pre_set_parameters_callback(before)
        made.add_on_set_parameters_callback(check("first", True))
        rejecting = check("second", False)
        made.add_on_set_parameters_callback(rejecting)
        made.add_post_set_parameters_callback(lambda parameters: told.append("after"))
        print(made.set_parameters([Parameter("a", value=1)]), told)
        made.remove_on_set_parameters_callback(rejecting)
        told.clear()
        print(made.set_parameters_atomically([Parameter("a", value=1)]), told)
        print(made.get_parameters(["a", "b"])[1].value)
        tell("remove again", made.remove_on_set_parameters_callback, rejecting)


def by_prefix() -> None:
    """Groups of parameters."""
    with node() as made:
        for name in ("a.b", "a.c.d", "a.c.e", "ab", "f"):
            made.declare_parameter(name, name)
        for prefix in ("a", "a.c", "", "x", "a."):
            tell(
                prefix,
                lambda p=prefix: {
                    name: each.value for name, each in made.get_parameters_by_prefix(p).items()
                },
            )
        for prefixes, depth in (([], 0), (["a"], 1), (["a"], 0), (["a.c"], 2), ([], 1), ([], 2), (["f"], 1)):
            found = made.list_parameters(prefixes, depth)
            names = [each for each in found.names if "use_sim" not in each and "type_desc" not in each]
            print(prefixes, depth, names, found.prefixes)
