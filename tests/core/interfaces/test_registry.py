"""Lookups in a registry."""

from __future__ import annotations

import re
import threading
import tracemalloc
from pathlib import Path

import pytest

from rwt_interfaces.distro import DISTROS, JAZZY, NOETIC, Distro
from rwt_interfaces.errors import DefinitionError, InvalidName, UnknownType
from rwt_interfaces.names import KINDS
from rwt_interfaces.registry import Registry

BOTH = pytest.mark.parametrize("distro", DISTROS.values(), ids=DISTROS)

#: What the published clients and their own test suites ask for by name, whichever server they meet.
ASKED_BY_CLIENTS = {
    "message": """
        std_msgs/String std_msgs/msg/String geometry_msgs/Twist geometry_msgs/msg/PoseStamped
        nav_msgs/OccupancyGrid sensor_msgs/CompressedImage sensor_msgs/PointCloud2
        visualization_msgs/MarkerArray tf2_msgs/TFMessage stereo_msgs/DisparityImage shape_msgs/Mesh
        trajectory_msgs/JointTrajectory diagnostic_msgs/DiagnosticArray rosgraph_msgs/Clock
        actionlib_msgs/GoalStatusArray actionlib_msgs/GoalID actionlib/TestAction
        actionlib_tutorials/FibonacciAction actionlib_tutorials/FibonacciActionGoal
        actionlib_tutorials/FibonacciActionResult actionlib_tutorials/FibonacciActionFeedback
        actionlib_tutorials/FibonacciGoal actionlib_tutorials/Fibonacci_Goal
        tf2_web_republisher/TFArray tf2_web_republisher/TFSubscriptionActionGoal
        tf2_web_republisher/TFSubscriptionActionFeedback rosapi/TypeDef rosapi_msgs/msg/TypeDef
        rosbridge_msgs/ConnectedClients nav2_msgs/NavigateToPose_Goal control_msgs/JointTolerance
        std_srvs/SetBool_Request std_srvs/srv/SetBoolResponse
    """,
    "service": """
        std_srvs/Empty std_srvs/SetBool std_srvs/srv/Trigger example_interfaces/AddTwoInts
        rospy_tutorials/AddTwoInts nav_msgs/GetMap nav_msgs/GetPlan sensor_msgs/SetCameraInfo
        tf2_web_republisher/RepublishTFs tf2_web_republisher_msgs/RepublishTFs
        rosauth/Authentication demo_interactive_markers/GetInit rosapi/Topics rosapi_msgs/srv/Topics
        rosapi/GetParam rosapi/SetParam rosapi/DeleteParam rosapi/HasParam rosapi/GetParamNames
        rosapi/SearchParam rosapi/TopicsForType rosapi/TopicsAndRawTypes rosapi/TopicType
        rosapi/Services rosapi/ServicesForType rosapi/ServiceType rosapi/ServiceProviders
        rosapi/ServiceNode rosapi/ServiceHost rosapi/ServiceRequestDetails
        rosapi/ServiceResponseDetails rosapi/MessageDetails rosapi/Nodes rosapi/NodeDetails
        rosapi/Publishers rosapi/Subscribers rosapi/GetActionServers rosapi/GetTime
        rosapi/GetROSVersion rosapi/Interfaces rosapi/ActionType rosapi/ActionGoalDetails
        rosapi/ActionResultDetails rosapi/ActionFeedbackDetails
    """,
    "action": """
        example_interfaces/action/Fibonacci actionlib_tutorials/Fibonacci
        actionlib_tutorials/FibonacciAction actionlib/Test tf2_web_republisher/TFSubscription
        tf2_web_republisher_interfaces/TFSubscription tf2_web_republisher_msgs/action/TFSubscription
        nav2_msgs/NavigateToPose control_msgs/FollowJointTrajectory
    """,
}

#: Messages of ROS 1's actions, which contain a goal id.
WRAPPED = re.compile("Action(Goal|Result|Feedback)?$")


def fields_of(registry: Registry, name: str) -> list[str]:
    return [field.name for field in registry.definition(name).fields]


@BOTH
def test_knows_what_clients_ask_for(distro: Distro) -> None:
    registry = Registry(distro)
    has_actionlib = registry.known_definition("actionlib_msgs/GoalID") is not None  # Until Kilted.
    for name in ASKED_BY_CLIENTS["message"].split():
        if not has_actionlib and (name.startswith("actionlib_msgs/") or WRAPPED.search(name)):
            continue
        assert registry.message(name).definition.fields, name
    for name in ASKED_BY_CLIENTS["service"].split():
        assert registry.service(name).response, name
    for name in ASKED_BY_CLIENTS["action"].split():
        assert registry.action(name).feedback, name


@BOTH
def test_everything_listed_can_be_compiled_and_is_its_own_name(distro: Distro) -> None:
    registry = Registry(distro)
    for name in registry.names("msg"):
        assert registry.message(name).name == name
    for name in registry.names("srv"):
        assert registry.service(name).name == name
    for name in registry.names("action"):
        assert registry.action(name).name == name


@BOTH
def test_both_spellings_are_one_type(distro: Distro) -> None:
    registry = Registry(distro)
    string = registry.message("std_msgs/String")
    assert registry.message("std_msgs/msg/String") is string
    assert registry.message("std_msgs//String/") is string
    assert registry.service("std_srvs/srv/SetBool") is registry.service("std_srvs/SetBool")
    assert registry.action("actionlib/action/Test") is registry.action("actionlib/TestAction")
    goal = registry.message("actionlib/TestGoal")
    assert registry.message("actionlib/Test_Goal") is goal
    assert registry.action("actionlib/Test").goal is goal
    request = registry.service("std_srvs/SetBool").request
    assert registry.message("std_srvs/SetBoolRequest") is request
    assert registry.message("std_srvs/srv/SetBool_Request") is request


def test_each_distribution_has_its_own_definitions() -> None:
    jazzy, noetic = Registry(JAZZY), Registry(NOETIC)
    assert fields_of(jazzy, "std_msgs/Header") == ["stamp", "frame_id"]
    assert fields_of(noetic, "std_msgs/Header") == ["seq", "stamp", "frame_id"]
    assert jazzy.definition("std_msgs/Header").fields[0].type.name == "builtin_interfaces/Time"
    assert noetic.definition("std_msgs/Header").fields[1].type.name == "time"
    assert jazzy.definition("geometry_msgs/Quaternion").fields[3].default == 1.0
    assert noetic.definition("geometry_msgs/Quaternion").fields[3].default is None
    assert fields_of(jazzy, "rosapi/GetParam_Request") == ["name", "default_value"]
    assert fields_of(jazzy, "rosapi/GetParam_Response") == ["value", "successful", "reason"]
    assert fields_of(noetic, "rosapi/GetParam_Request") == ["name", "default"]
    assert fields_of(noetic, "rosapi/GetParam_Response") == ["value"]
    assert noetic.definition("rosapi_msgs/GetTime_Response").fields[0].type.name == "time"


def test_what_a_distribution_calls_a_type() -> None:
    jazzy, noetic = Registry(JAZZY), Registry(NOETIC)
    assert jazzy.type_name(jazzy.message("std_msgs/String")) == "std_msgs/msg/String"
    assert jazzy.type_name(jazzy.service("std_srvs/SetBool")) == "std_srvs/srv/SetBool"
    assert jazzy.type_name(jazzy.action("actionlib/Test")) == "actionlib/action/Test"
    assert jazzy.type_name(jazzy.service("std_srvs/SetBool").request) == "std_srvs/srv/SetBool_Request"
    assert jazzy.type_name(jazzy.action("actionlib/Test").goal) == "actionlib/action/Test_Goal"
    assert jazzy.type_name(jazzy.message("actionlib/TestActionGoal")) == "actionlib/msg/TestActionGoal"
    assert noetic.type_name(noetic.message("std_msgs/msg/String")) == "std_msgs/String"
    assert noetic.type_name(noetic.service("std_srvs/SetBool").request) == "std_srvs/SetBoolRequest"
    assert noetic.type_name(noetic.action("actionlib/Test")) == "actionlib/Test"


def test_actions_are_carried_over_topics_as_ros_1_does() -> None:
    registry = Registry(JAZZY)
    registry.add_text("int32 a\n---\nint32 b\n---\nint32 c\n", "p/Go", "action")
    shapes = {
        name: [(field.name, field.type.name) for field in registry.definition(f"p/{name}").fields]
        for name in ("GoAction", "GoActionGoal", "GoActionResult", "GoActionFeedback")
    }
    header, status = ("header", "std_msgs/Header"), ("status", "actionlib_msgs/GoalStatus")
    assert shapes == {
        "GoAction": [
            ("action_goal", "p/GoActionGoal"),
            ("action_result", "p/GoActionResult"),
            ("action_feedback", "p/GoActionFeedback"),
        ],
        "GoActionGoal": [header, ("goal_id", "actionlib_msgs/GoalID"), ("goal", "p/Go_Goal")],
        "GoActionResult": [header, status, ("result", "p/Go_Result")],
        "GoActionFeedback": [header, status, ("feedback", "p/Go_Feedback")],
    }


def test_names_are_sorted_and_two_part() -> None:
    jazzy, noetic = Registry(JAZZY), Registry(NOETIC)
    for registry in (jazzy, noetic):
        for kind in KINDS:
            names = registry.names(kind)
            assert names == tuple(sorted(set(names)))
            assert all(name.count("/") == 1 for name in names)
    assert "actionlib_tutorials/FibonacciActionGoal" in noetic.names("msg")
    assert "actionlib_tutorials/FibonacciActionGoal" not in jazzy.names("msg")
    assert "rcl_interfaces/ListParameters" in jazzy.names("srv")
    jazzy.add_text("int8 a", "my_pkg/Mine")
    assert "my_pkg/Mine" in jazzy.names("msg")
    assert "my_pkg/Mine" not in Registry(JAZZY).names("msg")


@pytest.mark.parametrize(
    ("ask", "name", "text"),
    [
        ("message", "std_msgs/Strin", 'no message "std_msgs/Strin" is known; did you mean std_msgs/String?'),
        ("message", "std_msgs/msg/string", "did you mean std_msgs/String or example_interfaces/String?"),
        ("message", "String",
         "expected package/Name, for example std_msgs/String; did you mean std_msgs/Str"),
        ("message", "geometry/Twist", "did you mean geometry_msgs/Twist?"),
        ("message", "foo/Bar", 'no message "foo/Bar" is known'),
        ("message", "std_srvs/SetBool", "it is a service"),
        ("service", "std_msgs/String", "it is a message"),
        ("action", "std_srvs/SetBool", "it is a service"),
        ("action", "nav2_msgs/NavigateTo", "did you mean nav2_msgs/NavigateToPose or"),
        ("service", "a b", "is not a type name"),
        ("message", "std_srvs/_Request", "is not a type name"),
        ("message", "std_msgs/Request", 'no message "std_msgs/Request" is known'),
        ("message", "x/" + "y" * 400, "is known"),
        ("message", "x" * 100_000, "type name of 100000 characters"),
    ],
)  # fmt: skip
def test_unknown_types_name_what_may_have_been_meant(ask: str, name: str, text: str) -> None:
    registry = Registry()
    with pytest.raises(UnknownType) as caught:
        getattr(registry, ask)(name)
    assert text in str(caught.value)
    assert len(str(caught.value)) < 700


def test_asking_for_names_that_do_not_exist_leaves_nothing_behind() -> None:
    registry = Registry()

    def ask(number: int) -> None:
        registry.message("std_msgs" + "/" * (number % 400 + 2) + "String" + "/" * (number % 90))
        with pytest.raises(UnknownType):
            registry.message(f"std_msgs/{'N' * 120}{number}")

    ask(0)
    tracemalloc.start()
    try:
        for number in range(1, 2000):
            ask(number)
        grown, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert grown < 100_000


@BOTH
def test_full_text_is_the_definition_and_all_it_contains(distro: Distro) -> None:
    registry = Registry(distro)
    registry.add_text("# Two stamps.\nHeader header\nPart[] parts # many\nPart last\n", "p/Whole")
    registry.add_text("time at\n", "p/Part")
    text = registry.full_text(registry.message("p/Whole"))
    root, *sections = text.split("\n" + "=" * 80 + "\n")
    assert root == "# Two stamps.\nHeader header\nPart[] parts # many\nPart last\n"
    heads = [section.splitlines()[0] for section in sections]
    if distro is NOETIC:
        assert heads == ["MSG: std_msgs/Header", "MSG: p/Part"]
        assert sections[0] == "MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
    else:
        assert heads == ["MSG: std_msgs/Header", "MSG: builtin_interfaces/Time", "MSG: p/Part"]
        assert sections[2] == "MSG: p/Part\nbuiltin_interfaces/Time at\n"


def test_full_text_of_every_listed_message_names_each_dependency_once() -> None:
    for distro in (JAZZY, NOETIC):
        registry = Registry(distro)
        for name in registry.names("msg"):
            heads = [
                line
                for line in registry.full_text(registry.message(name)).splitlines()
                if line.startswith("MSG: ")
            ]
            assert len(heads) == len(set(heads))
            assert f"MSG: {name}" not in heads


# The user's own


def test_added_text_is_known_in_both_spellings() -> None:
    registry = Registry()
    registry.add_text("Part[] parts\n", "my_pkg/msg/Whole")
    registry.add_text("string<=5 name 'a'\n", "my_pkg/Part", "msg")
    registry.add_text("Part part\n---\nbool ok\n", "my_pkg/Check", "srv")
    assert registry.message("my_pkg/msg/Whole") is registry.message("my_pkg/Whole")
    assert registry.message("my_pkg/Part").definition.fields[0].default == "a"
    assert registry.service("my_pkg/srv/Check").request.definition.fields[0].type.name == "my_pkg/Part"
    registry.verify()


def test_added_text_that_cannot_be_read_changes_nothing() -> None:
    registry = Registry()
    with pytest.raises(DefinitionError, match=r"^my_pkg/Thing\.msg:2: "):
        registry.add_text("int8 a\nint8 a", "my_pkg/Thing")
    with pytest.raises(InvalidName):
        registry.add_text("int8 a", "Thing")
    with pytest.raises(InvalidName, match='"message" is not a kind'):
        registry.add_text("int8 a", "my_pkg/Thing", "message")  # type: ignore[arg-type]  # the mistake under test
    with pytest.raises(UnknownType):
        registry.message("my_pkg/Thing")


def test_a_user_definition_wins_over_the_standard_one_in_its_registry_only() -> None:
    registry = Registry()
    before = registry.message("geometry_msgs/PoseStamped")
    registry.add_text("float64 x\nfloat64 y\n", "geometry_msgs/Point")
    assert fields_of(registry, "geometry_msgs/Point") == ["x", "y"]
    assert registry.message("geometry_msgs/PoseStamped") is not before
    assert fields_of(Registry(), "geometry_msgs/Point") == ["x", "y", "z"]


def test_repeating_a_definition_keeps_the_types_that_exist() -> None:
    registry = Registry()
    before = registry.message("geometry_msgs/Point")
    registry.add_text("float64 x # east\nfloat64 y\nfloat64 z\n", "geometry_msgs/Point")
    assert registry.message("geometry_msgs/Point") is before


def test_a_message_may_take_the_name_of_an_actions_part() -> None:
    registry = Registry()
    assert fields_of(registry, "actionlib/TestGoal") == ["goal"]
    registry.message("actionlib/TestGoal")
    registry.add_text("int8 other\n", "actionlib/TestGoal")
    assert [field.name for field in registry.message("actionlib/TestGoal").definition.fields] == ["other"]


def test_a_missing_part_is_named_with_where_it_is_missing() -> None:
    registry = Registry()
    registry.add_text("Inner inner\n", "p/Outer")
    registry.add_text("geometry_msgs/Pont where\n", "p/Inner")
    message = 'p/Inner.msg:1: no message "geometry_msgs/Pont" is known; did you mean geometry_msgs/Point'
    for ask in (lambda: registry.message("p/Outer"), registry.verify):
        with pytest.raises(UnknownType) as caught:
            ask()
        assert message in str(caught.value)
    registry.add_text("geometry_msgs/Point where\n", "p/Inner")
    registry.verify()
    assert registry.message("p/Outer")


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("float23", "float32"),
        ("strng[]", "string"),
        ("boolean", "bool"),
        ("double[3]", "float64"),
        ("Float", "float32 or float64"),
        ("Statu", "p/Status"),
        ("Heder", "std_msgs/Header"),
        ("Twits", "geometry_msgs/Twist"),
    ],
)
def test_a_type_without_a_package_may_be_a_primitive_or_a_message_of_any(
    tmp_path: Path, word: str, meant: str
) -> None:
    package = tmp_path / "p" / "msg"
    package.mkdir(parents=True)
    (package / "Status.msg").write_text("bool ok\n")
    (package / "Broken.msg").write_text(f"# A comment.\nint8 fine\n{word} field\n")
    registry = Registry()
    registry.add_directory(tmp_path)
    base = word.partition("[")[0]
    known = f'no primitive is called "{base}", and no message of p'
    text = f"{package / 'Broken.msg'}:3: {known}; did you mean {meant}?"
    for ask in (registry.verify, lambda: registry.message("p/Broken")):
        with pytest.raises(UnknownType) as caught:
            ask()
        assert str(caught.value) == text


def test_threads_that_ask_at_once_get_the_same_type() -> None:
    registry = Registry()
    start = threading.Barrier(8)
    answers: list[object] = []

    def ask() -> None:
        start.wait()
        answers.append(registry.message("visualization_msgs/InteractiveMarkerUpdate"))

    threads = [threading.Thread(target=ask) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(answers) == 8
    assert len(set(map(id, answers))) == 1
