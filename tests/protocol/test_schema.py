"""The JSON Schema of the protocol: complete, closed, and different by profile."""

from __future__ import annotations

import json
from typing import Any

import pytest

from rwt_protocol.ops import OPS
from rwt_protocol.profiles import COMPAT, PROFILES, ROS1, V2_0_0, Profile
from rwt_protocol.schema import protocol_asyncapi, protocol_schema
from tests.protocol.wire_examples import EXAMPLES, Example


def document(profile: Profile = COMPAT) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(json.dumps(protocol_schema(profile)))
    return found


def definition(op: str, profile: Profile = COMPAT) -> dict[str, Any]:
    whole = document(profile)
    reference: str = whole["discriminator"]["mapping"][op]
    found: dict[str, Any] = whole["$defs"][reference.removeprefix("#/$defs/")]
    return found


def references(value: Any) -> set[str]:
    if isinstance(value, dict):
        own = {value["$ref"]} if "$ref" in value else set()
        return own.union(*map(references, value.values()))
    return set().union(*map(references, value)) if isinstance(value, list) else set()


@pytest.mark.parametrize("profile", PROFILES.values(), ids=lambda profile: str(profile.name))
def test_it_describes_each_op_of_the_profile(profile: Profile) -> None:
    whole = document(profile)
    assert set(whole["discriminator"]["mapping"]) == profile.ops
    assert len(whole["oneOf"]) == len(profile.ops)
    assert references(whole) == {f"#/$defs/{name}" for name in whole["$defs"]}
    for op in profile.ops:
        described = definition(op, profile)
        expected = set(OPS[op].model.model_fields) - profile.without.get(op, frozenset())
        assert set(described["properties"]) == expected
        assert described["required"][0] == "op"
        assert described["x-direction"] == profile.direction(op).value


@pytest.mark.parametrize("example", EXAMPLES.examples, ids=lambda example: str(example.name))
def test_it_requires_what_the_models_require(example: Example) -> None:
    described = definition(example.message["op"])
    missing = set(described["required"]) - set(example.message)
    if example.valid:
        assert not missing


def test_members_say_what_they_hold() -> None:
    publish = definition("publish")["properties"]
    assert publish["op"] == {"const": "publish"}
    assert (publish["msg"]["type"], publish["msg"]["default"]) == ("object", {})
    assert definition("call_service")["properties"]["args"]["type"] == ["object", "array"]
    assert definition("service_response")["properties"]["values"]["type"] == ["object", "string"]
    assert definition("subscribe")["properties"]["queue_length"]["minimum"] == 0
    assert definition("set_level")["properties"]["op"]["enum"] == [
        "set_level",
        "set_status_level",
        "status_level",
    ]


def test_profiles_differ() -> None:
    assert "timeout" not in definition("call_service", ROS1)["properties"]
    assert "timeout" in definition("call_service", V2_0_0)["properties"]
    assert "Qos" not in document(ROS1)["$defs"]
    assert "Qos" in document(COMPAT)["$defs"]


@pytest.mark.parametrize("profile", PROFILES.values(), ids=lambda profile: str(profile.name))
def test_asyncapi_says_who_sends_what(profile: Profile) -> None:
    whole: dict[str, Any] = json.loads(json.dumps(protocol_asyncapi(profile, "1.2.3")))
    assert (whole["asyncapi"], whole["info"]["version"]) == ("3.0.0", "1.2.3")
    for reference in references(whole):
        found: Any = whole
        for part in reference.removeprefix("#/").split("/"):
            found = found[part]
    for name, side in (("receive", "client to server"), ("send", "server to client")):
        ops = {message["$ref"].rpartition("/")[2] for message in whole["operations"][name]["messages"]}
        assert ops == {op for op in profile.ops if profile.direction(op).value in (side, "both")}
