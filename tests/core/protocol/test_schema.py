"""The JSON Schema of the protocol: complete, closed, and different by profile."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from rwt_protocol.ops import OPS
from rwt_protocol.profiles import COMPAT, PROFILES, ROS1, V2_0_0, Profile
from rwt_protocol.schema import main, protocol_asyncapi, protocol_schema
from tests.core.protocol.test_library import INVALID, VALID
from tests.core.protocol.wire_examples import Example

ROOT = Path(__file__).parents[3]


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


@pytest.mark.extended  # The schema comes from npm.
@pytest.mark.parametrize("profile", PROFILES.values(), ids=lambda profile: str(profile.name))
def test_asyncapi_fits_the_schema_that_asyncapi_publishes(profile: Profile) -> None:
    whole: dict[str, Any] = json.loads(json.dumps(protocol_asyncapi(profile, "1.2.3")))
    published = ROOT / "tests/clients/node/node_modules/@asyncapi/specs/schemas" / f"{whole['asyncapi']}.json"
    validator = jsonschema.Draft7Validator(json.loads(published.read_text(encoding="utf-8")))
    assert [error.message for error in validator.iter_errors(whole)] == []
    whole["operations"]["receive"]["action"] = "hear"
    assert not validator.is_valid(whole)


@pytest.mark.parametrize("profile", PROFILES.values(), ids=lambda profile: str(profile.name))
def test_the_documents_are_of_the_kinds_that_they_say(profile: Profile) -> None:
    jsonschema.Draft202012Validator.check_schema(document(profile))
    asyncapi = protocol_asyncapi(profile)
    assert set(asyncapi) <= {"asyncapi", "info", "defaultContentType", "channels", "operations", "components"}
    schemas: Any = asyncapi["components"]
    for schema in schemas["schemas"].values():
        jsonschema.Draft202012Validator.check_schema(schema)


@pytest.mark.parametrize("example", VALID, ids=lambda example: str(example.name))
def test_messages_that_are_taken_satisfy_it(example: Example) -> None:
    jsonschema.Draft202012Validator(document()).validate(example.message)


@pytest.mark.parametrize("example", INVALID, ids=lambda example: str(example.name))
def test_messages_that_are_refused_do_not(example: Example) -> None:
    assert not jsonschema.Draft202012Validator(document()).is_valid(example.message)


def test_a_command_writes_both_for_each_version(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "folder"
    done = subprocess.run(
        [sys.executable, "-m", "rwt_protocol.schema", str(folder)], capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    written = {Path(line) for line in done.stdout.splitlines()}
    assert written == set(folder.iterdir())
    assert len(written) == 2 * len(PROFILES)
    for name, profile in PROFILES.items():
        for kind, made in (("schema", protocol_schema), ("asyncapi", protocol_asyncapi)):
            text = (folder / f"rosbridge-{name}.{kind}.json").read_text(encoding="utf-8")
            assert json.loads(text) == json.loads(json.dumps(made(profile)))


def test_the_command_says_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == main(["--help"]) == 2
    assert capsys.readouterr().err.startswith("usage: python -m rwt_protocol.schema FOLDER\n")
    file = tmp_path / "file"
    file.touch()
    assert main([str(file)]) == 1
    assert capsys.readouterr().err == f"cannot write to {file}: File exists\n"
