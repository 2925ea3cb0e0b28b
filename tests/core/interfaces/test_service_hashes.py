"""Type hashes of services, and the services and messages that carry an action on ROS 2."""

from __future__ import annotations

from typing import Any

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from rwt_interfaces.definitions.parser import format_type
from rwt_interfaces.distro import NOETIC
from rwt_interfaces.errors import UnknownType
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import ServiceType

REGISTRY = Registry()


@pytest.mark.parametrize(
    ("name", "rihs01"),
    [
        # As the packages of ROS 2 carry them.
        ("example_interfaces/AddTwoInts", "e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"),
        ("rcl_interfaces/GetParameters", "bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc"),
        ("rcl_interfaces/SetParameters", "56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0"),
        ("action_msgs/CancelGoal", "573d8b0a534451d7bc2ac8c5ffde8ac14b8593b7001175d0cd6516dcbeb8689a"),
        ("example_interfaces/Fibonacci_SendGoal",
         "d1a57fb2a4afe8c21e34fb10db206f16ce6729b28531141472df92277c55b557"),
        ("example_interfaces/Fibonacci_GetResult",
         "1b0de0d5d29dc955d92f546706568428632771db13ec84c15ec1c1a59f424a57"),
        ("example_interfaces/Fibonacci_FeedbackMessage",
         "c1de71afd52e49a89c53d8262366884185bc0a02f78ce051c4e46b0a7fe59bb2"),
    ],
)  # fmt: skip
def test_known_hashes(name: str, rihs01: str) -> None:
    find = REGISTRY.message if name.endswith("Message") else REGISTRY.service
    assert find(name).rihs01 == f"RIHS01_{rihs01}"


#: The independent implementation knows messages only, and takes `char` for C's.
_EVENT_INFO = """\
uint8 event_type
builtin_interfaces/Time stamp
uint8[16] client_gid
int64 sequence_number
"""


def by_rosbags(service: ServiceType) -> str:
    """The hash of a message that is put together like the service's description."""
    store: Any = Typestore()
    store.fielddefs.update(get_typestore(Stores.ROS2_JAZZY).fielddefs)
    store.fielddefs.update(get_types_from_msg(_EVENT_INFO, "service_msgs/msg/ServiceEventInfo"))
    full = REGISTRY.type_name(service)
    for part in (service.request, service.response):
        text = "\n".join(f"{format_type(f.type)} {f.name}" for f in part.definition.fields)
        filler = "uint8 structure_needs_at_least_one_member"
        (fields,) = get_types_from_msg(text or filler, "x/msg/X").values()
        store.fielddefs[REGISTRY.full_name(part.name)] = fields
    name, sequence = 2, 4
    request, response = (REGISTRY.full_name(part.name) for part in (service.request, service.response))
    store.fielddefs[f"{full}_Event"] = (
        [],
        [
            ("info", (name, "service_msgs/msg/ServiceEventInfo")),
            ("request", (sequence, ((name, request), 1))),
            ("response", (sequence, ((name, response), 1))),
        ],
    )
    store.fielddefs[full] = (
        [],
        [
            ("request_message", (name, request)),
            ("response_message", (name, response)),
            ("event_message", (name, f"{full}_Event")),
        ],
    )
    found: str = store.hash_rihs01(full)
    return found


def test_every_service_hashes_as_by_an_independent_implementation() -> None:
    known = get_typestore(Stores.ROS2_JAZZY).fielddefs
    checked = 0
    for name in REGISTRY.names("srv"):
        service = REGISTRY.service(name)
        nested = [
            field.type
            for part in (service.request, service.response)
            for field in part.definition.fields
            if not field.type.is_primitive
        ]
        chars = any(
            f.type.name == "char" for p in (service.request, service.response) for f in p.definition.fields
        )
        if not chars and all(REGISTRY.full_name(type.name) in known for type in nested):
            assert service.rihs01 == by_rosbags(service), name
            checked += 1
    assert checked > 70


def test_the_parts_of_an_action_have_its_fields() -> None:
    send = REGISTRY.service("example_interfaces/action/Fibonacci_SendGoal")
    fields = {
        part.name: [(f.name, format_type(f.type)) for f in part.definition.fields]
        for part in (
            send.request,
            send.response,
            REGISTRY.service("example_interfaces/Fibonacci_GetResult").request,
            REGISTRY.service("example_interfaces/Fibonacci_GetResult").response,
            REGISTRY.message("example_interfaces/Fibonacci_FeedbackMessage"),
        )
    }
    action = "example_interfaces/Fibonacci"
    uuid = ("goal_id", "unique_identifier_msgs/UUID")
    assert fields == {
        f"{action}_SendGoal_Request": [uuid, ("goal", f"{action}_Goal")],
        f"{action}_SendGoal_Response": [("accepted", "bool"), ("stamp", "builtin_interfaces/Time")],
        f"{action}_GetResult_Request": [uuid],
        f"{action}_GetResult_Response": [("status", "int8"), ("result", f"{action}_Result")],
        f"{action}_FeedbackMessage": [uuid, ("feedback", f"{action}_Feedback")],
    }


@pytest.mark.parametrize(
    ("two_part", "three_part"),
    [
        ("Fibonacci_SendGoal_Request", "example_interfaces/action/Fibonacci_SendGoal_Request"),
        ("Fibonacci_FeedbackMessage", "example_interfaces/action/Fibonacci_FeedbackMessage"),
        ("AddTwoInts_Request", "example_interfaces/srv/AddTwoInts_Request"),
    ],
)
def test_full_names_say_where_a_part_is_defined(two_part: str, three_part: str) -> None:
    assert REGISTRY.full_name(f"example_interfaces/{two_part}") == three_part


def test_the_name_of_an_actions_service() -> None:
    service = REGISTRY.service("example_interfaces/Fibonacci_GetResult")
    assert REGISTRY.type_name(service) == "example_interfaces/action/Fibonacci_GetResult"


@pytest.mark.parametrize("name", ["Fibonacci_SendGoal", "Fibonacci_GetResult"])
def test_ros_1_carries_actions_otherwise(name: str) -> None:
    registry = Registry(NOETIC)
    with pytest.raises(UnknownType):
        registry.service(f"actionlib_tutorials/{name}")
    with pytest.raises(UnknownType):
        registry.message("actionlib_tutorials/Fibonacci_FeedbackMessage")


def test_a_service_that_is_written_as_such_wins() -> None:
    registry = Registry()
    registry.add_text("int8 own\n---\n", "example_interfaces/Fibonacci_SendGoal", "srv")
    service = registry.service("example_interfaces/Fibonacci_SendGoal")
    assert [field.name for field in service.request.definition.fields] == ["own"]
    assert registry.type_name(service) == "example_interfaces/srv/Fibonacci_SendGoal"
