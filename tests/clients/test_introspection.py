"""rosapi through the methods that each client library has for it, and parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from tests.clients.conftest import Program

pytestmark = pytest.mark.clients

ROBOT_TOPICS = {
    "/cmd_vel": "geometry_msgs/Twist",
    "/odom": "nav_msgs/Odometry",
    "/tf": "tf2_msgs/TFMessage",
    "/tf_static": "tf2_msgs/TFMessage",
    "/scan": "sensor_msgs/LaserScan",
    "/map": "nav_msgs/OccupancyGrid",
    "/battery_state": "sensor_msgs/BatteryState",
    "/joint_states": "sensor_msgs/JointState",
    "/diagnostics": "diagnostic_msgs/DiagnosticArray",
    "/chatter": "std_msgs/String",
    "/robot_description": "std_msgs/String",
}
LOG = {"jazzy": "rcl_interfaces/msg/Log", "noetic": "rosgraph_msgs/Log"}
FLOAT64 = {"jazzy": "double", "noetic": "float64"}
MAX_SPEED = {"jazzy": "/demo_robot:max_speed", "noetic": "/demo_robot/max_speed"}


def type_name(distro: str, two_part: str, kind: str = "msg") -> str:
    return two_part.replace("/", f"/{kind}/") if distro == "jazzy" else two_part


def add_type(distro: str) -> str:
    return "example_interfaces/srv/AddTwoInts" if distro == "jazzy" else "rospy_tutorials/AddTwoInts"


def decoded_header(distro: str) -> dict[str, Any]:
    if distro == "noetic":
        return {"seq": "uint32", "stamp": "time", "frame_id": "string"}
    return {"stamp": {"sec": "int32", "nanosec": "uint32"}, "frame_id": "string"}


def refusal(client: Program, answer: dict[str, Any]) -> str:
    """Why a parameter was not set: roslib 2 hands over the reason, the older libraries the whole answer."""
    if client.name == "roslib2":
        return str(answer["failed"])
    assert answer["values"]["successful"] is False
    return str(answer["values"]["reason"])


def test_topics_and_their_types(client: Program, distro: str) -> None:
    observed = client.observe("rosapi_topics")
    answer = observed["topics"]["values"]
    # roslibpy returns the names alone.
    names = answer if client.name == "roslibpy" else answer["topics"]
    assert ROBOT_TOPICS.keys() | {"/rosout"} <= set(names)
    assert len(names) == len(set(names))
    if client.name != "roslibpy":
        types = dict(zip(names, answer["types"], strict=True))
        assert {name: types[name] for name in ROBOT_TOPICS} == {
            name: type_name(distro, type_) for name, type_ in ROBOT_TOPICS.items()
        }
        assert types["/rosout"] == LOG[distro]
    assert observed["type"] == {"values": type_name(distro, "nav_msgs/Odometry")}
    assert observed["unknown"] == {"values": ""}
    assert observed["of_type"] == {"values": ["/odom"]}
    assert observed["of_three_part_type"] == {"values": ["/odom"]}


def test_every_topic_has_a_definition(roslib: Program, distro: str) -> None:
    raw = roslib.observe("rosapi_topics")["raw"]["values"]
    texts = dict(zip(raw["topics"], raw["typedefs_full_text"], strict=True))
    types = dict(zip(raw["topics"], raw["types"], strict=True))
    assert all(text.strip() for text in texts.values())
    assert types["/cmd_vel"] == type_name(distro, "geometry_msgs/Twist")
    own, *dependencies = texts["/cmd_vel"].split("=" * 80 + "\n")
    fields = [line.split() for line in own.splitlines() if line.strip() and not line.startswith("#")]
    assert [field[:2] for field in fields] == [["Vector3", "linear"], ["Vector3", "angular"]]
    assert [text.splitlines()[0] for text in dependencies] == ["MSG: geometry_msgs/Vector3"]


def test_services_and_their_types(client: Program, distro: str) -> None:
    observed = client.observe("rosapi_services")
    services = observed["services"]["values"]
    assert {"/add_two_ints", "/reset", "/enable_motors", "/rosapi/topics", "/rosapi/services"} <= set(
        services
    )
    assert observed["type"] == add_type(distro)
    assert observed["unknown"] == {"values": ""}
    assert observed["of_type"] == {"values": ["/add_two_ints"]}
    request, response = (observed[part]["values"]["typedefs"][0] for part in ("request", "response"))
    assert (request["fieldnames"], request["fieldtypes"]) == (["a", "b"], ["int64", "int64"])
    assert (response["fieldnames"], response["fieldtypes"]) == (["sum"], ["int64"])
    assert request["fieldarraylen"] == [-1, -1]


def test_nodes_and_what_they_do(client: Program) -> None:
    observed = client.observe("rosapi_nodes")
    assert {"/demo_robot", "/rosapi"} <= set(observed["nodes"]["values"])
    details = observed["details"]
    assert "/cmd_vel" in details["subscribing"]
    assert {"/odom", "/scan", "/tf"} <= set(details["publishing"])
    assert "/cmd_vel" not in details["publishing"]
    assert {"/add_two_ints", "/reset"} <= set(details["services"])


def test_publishers_of_a_topic(roslib2: Program) -> None:
    assert roslib2.observe("publishers") == {"odom": {"values": ["/demo_robot"]}, "unknown": {"values": []}}


def test_message_details(client: Program, distro: str) -> None:
    observed = client.observe("rosapi_messages")
    details = observed["details"]["values"]
    twist, vector = details["typedefs"] if client.name == "roslibpy" else details
    assert (twist["type"], vector["type"]) == ("geometry_msgs/Twist", "geometry_msgs/Vector3")
    assert twist["fieldnames"] == ["linear", "angular"]
    assert twist["fieldtypes"] == ["geometry_msgs/Vector3", "geometry_msgs/Vector3"]
    assert twist["examples"] == ["{}", "{}"]
    assert vector["fieldtypes"] == [FLOAT64[distro]] * 3
    # An unknown type has no definition, whichever way the client is told.
    assert not observed["unknown"].get("values")


def test_message_details_are_decoded(roslib: Program, distro: str) -> None:
    observed = roslib.observe("rosapi_messages")
    number = FLOAT64[distro]
    vector = {"x": number, "y": number, "z": number}
    assert observed["twist"] == {"linear": vector, "angular": vector}
    assert observed["odometry"] == {
        "header": decoded_header(distro),
        "child_frame_id": "string",
        "pose": {
            "pose": {"position": vector, "orientation": {**vector, "w": number}},
            "covariance": [number],
        },
        "twist": {"twist": {"linear": vector, "angular": vector}, "covariance": [number]},
    }


def test_action_servers(client: Program) -> None:
    # Servers of clients that have just left may still be there.
    servers = client.observe("rosapi_actions")["values"]
    assert {"/fibonacci", "/navigate_to_pose"} <= set(servers)
    assert len(servers) == len(set(servers))


@pytest.mark.parametrize("distro", ["noetic"], indirect=True)
def test_the_servers_time(roslibpy: Program) -> None:
    observed = roslibpy.observe("rosapi_time")
    assert observed["server"] == pytest.approx(observed["now"], abs=5)


def test_the_robots_parameter(client: Program, distro: str) -> None:
    observed = client.observe(f"robot_parameter {MAX_SPEED[distro]}")
    assert observed["listed"] is True
    assert observed["before"]["values"] > 0
    assert observed["after"] == {"values": 0.25}
    assert observed["has"] == {"values": {"exists": True}}


@pytest.mark.parametrize("distro", ["jazzy"], indirect=True)
def test_values_that_the_robot_refuses(client: Program, distro: str) -> None:
    observed = client.observe(f"refused_parameter {MAX_SPEED[distro]}")
    assert "string" in refusal(client, observed["word"])
    assert "max_speed" in refusal(client, observed["negative"])
    assert observed["unchanged"] is True


def test_a_parameter_of_the_clients_own(client: Program, distro: str) -> None:
    observed = client.observe("own_parameter")
    exists, absent = {"values": {"exists": True}}, {"values": {"exists": False}}
    assert observed["had"] == absent
    assert observed["kept"] == [42, -0.5, 'text "ü"', True, [1, 2, 3], ["a", "b"]]
    assert observed["listed"] is True
    assert observed["has_now"] == exists
    assert observed["has_after"] == absent
    if client.name == "roslib2" and distro == "jazzy":
        assert f"/{client.name}/answer" in observed["get_after"]["failed"]
    else:
        assert observed["get_after"] == {"values": None}
