"""The document is valid to others, says what really comes, and clients that others generate from it work."""

from __future__ import annotations

import importlib
import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import anyio.to_thread
import httpx
import pytest
from jsonschema import Draft202012Validator
from openapi_spec_validator import OpenAPIV31SpecValidator

from rwt import Server, Settings
from rwt.access.access import Access
from rwt.extensions.http.openapi import describe
from rwt.extensions.http.schemas import Schemas, document
from rwt_interfaces import standard
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from tests.conftest import REGISTRIES
from tests.extensions.conftest import client_of
from tests.extensions.http.conftest import Robot

pytestmark = pytest.mark.anyio

NODE = Path(__file__).parent / "node"


def validator_of(document: dict[str, Any], schema: dict[str, Any]) -> Draft202012Validator:
    """Checks values against a schema of a document, whose other schemas it names."""
    return Draft202012Validator({**schema, "components": document["components"]})


async def test_the_document_is_valid_to_others(described: Path) -> None:
    document = json.loads(await anyio.Path(described).read_bytes())
    assert document["openapi"] == "3.1.0"
    await anyio.to_thread.run_sync(OpenAPIV31SpecValidator(document).validate)


async def test_streams_of_events_are_described_as_responses(described: Path) -> None:
    document = json.loads(await anyio.Path(described).read_bytes())
    for path in ("/api/topics/open/label", "/api/actions/open/count/goals/{goal_id}"):
        content = document["paths"][path]["get"]["responses"]["200"]["content"]
        assert list(content) == ["application/json", "application/cbor", "text/event-stream"]
        assert content["text/event-stream"]["schema"] == {"$ref": "#/components/schemas/EventStream"}
    assert document["components"]["schemas"]["EventStream"]["type"] == "string"


async def test_what_a_robot_sends_is_as_the_document_says() -> None:
    server = Server("ws://127.0.0.1:0", demo=True, web={"enabled": False})
    async with server, client_of(server) as client:
        document = (await client.get("/api/openapi.json")).json()
        services = (await client.get("/api/services")).json()
        assert {f"/api/services{service['name']}" for service in services} <= set(document["paths"])
        for topic in ("map", "scan", "odom", "battery_state", "camera/camera_info", "tf"):
            operation = document["paths"][f"/api/topics/{topic}"]["get"]
            schema = operation["responses"]["200"]["content"]["application/json"]["schema"]
            message = (await client.get(f"/api/topics/{topic}")).json()
            validator_of(document, schema).validate(message)


@pytest.mark.parametrize("distro", sorted(DISTROS))
def test_every_type_of_the_standard_set_fits_its_schema(distro: str) -> None:
    registry = REGISTRIES[distro]
    names = [
        f"{package}/{name}"
        for package in standard.packages(distro)
        for kind, name in standard.package(distro, package)
        if kind == "msg"
    ]
    assert len(names) > 100
    schemas = Schemas("#/components/schemas/")
    for name in names:
        message = registry.message(name)
        sent, taken = schemas.reference(message), schemas.reference(message, incoming=True)
        components = {"components": {"schemas": schemas.found}}
        default = json.loads(bytes(Payload.from_json(message, b"{}").json()))
        Draft202012Validator({**sent, **components}).validate(default)
        Draft202012Validator({**taken, **components}).validate({})
        Draft202012Validator({**taken, **components}).validate(default)
    Draft202012Validator.check_schema(document(registry.message("sensor_msgs/Image")))


def test_each_bound_of_a_definition_is_in_the_schema() -> None:
    registry = Registry()
    text = (
        "string<=5 name\nint8[3] three\nuint16[<=2] few\nuint8[4] octets\n"
        "uint8 LOW=1\nint32 level 7\nfloat32 x\n"
    )
    registry.add_text(text, "my/Bounds")
    schemas = Schemas()
    fields = schemas.reference(registry.message("my/Bounds"), incoming=True)
    found: Any = schemas.found["my.Bounds.Input"]
    assert fields == {"$ref": "#/components/schemas/my.Bounds.Input"}
    assert found["description"] == "my/msg/Bounds; constants: LOW = 1" and "required" not in found
    byte = {"type": "integer", "minimum": -128, "maximum": 127}
    short = {"type": "integer", "minimum": 0, "maximum": 65535}
    level = {"type": "integer", "minimum": -(2**31), "maximum": 2**31 - 1, "default": 7}
    assert found["properties"] == {
        "name": {"type": "string", "maxLength": 5},
        "three": {"type": "array", "items": byte, "minItems": 3, "maxItems": 3},
        "few": {"type": "array", "items": short, "maxItems": 2},
        "octets": {
            "type": "string",
            "contentEncoding": "base64",
            "pattern": "^([A-Za-z0-9+/]{4}){1}[A-Za-z0-9+/]{2}==$",
        },
        "level": level,
        "x": {"type": ["number", "null"], "format": "float"},
    }


async def test_names_that_look_alike_have_operations_of_their_own(robot: Robot, server: Server) -> None:
    robot.node.advertise("/open_talk", "std_msgs/String")
    access = Access(server.graph, Settings())
    client = access.nobody
    client.role = access.admission.roles["admin"]
    paths: Any = describe(client, "/robot", "a robot")["paths"]
    operations = [
        operation["operationId"]
        for item in paths.values()
        for operation in item.values()
        if "operationId" in operation
    ]
    assert len(operations) == len(set(operations))
    assert {"get_open_talk", "get_open_talk_2"} <= set(operations)


# -- generated clients -------------------------------------------------------------------------------------


@pytest.fixture
async def described(robot: Robot, client: httpx.AsyncClient, tmp_path: Path) -> Path:
    """The document in a file."""
    path = tmp_path / "openapi.json"
    path.write_bytes((await client.get("/api/openapi.json")).content)
    return path


@pytest.mark.extended
@pytest.mark.timeout(300)  # The generators are programs of their own.
async def test_a_generated_client_in_python_works(
    described: Path, client: httpx.AsyncClient, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = described.parent / "generated_robot"
    program = Path(sys.executable).parent / "openapi-python-client"
    config = described.parent / "config.yml"
    config.write_text("post_hooks: []\npackage_name_override: generated_robot\n")
    command = [str(program), "generate", "--path", str(described), "--meta", "none",
               "--output-path", str(package), "--config", str(config)]  # fmt: skip
    made = await anyio.to_thread.run_sync(
        lambda: subprocess.run(command, capture_output=True, text=True, timeout=100)
    )
    assert made.returncode == 0, made.stdout + made.stderr
    assert "Warning" not in made.stdout, made.stdout
    monkeypatch.syspath_prepend(str(described.parent))

    def module(name: str) -> Any:
        return importlib.import_module(f"generated_robot.{name}")

    try:
        unused = module("client").Client(base_url=str(client.base_url), httpx_args={"trust_env": False})
        async with unused as robot_client:
            models = module("models")
            label = await module("api.topics.get_open_label").asyncio(client=robot_client)
            assert label.data == "the open"
            add = module("api.services.call_open_add")
            body = models.ExampleInterfacesAddTwoIntsRequestInput(a=2, b=40)
            assert (await add.asyncio(client=robot_client, body=body)).sum_ == 42
            twist = models.GeometryMsgsTwistInput(linear=models.GeometryMsgsVector3Input(x=0.25))
            publish = module("api.topics.publish_open_heard")
            answer = await publish.asyncio_detailed(client=robot_client, body=twist)
            assert answer.status_code == 204
            heard: Any = robot.heard[0]
            assert heard.linear.x == 0.25
            goal = await module("api.actions.send_goal_open_count").asyncio(
                client=robot_client, body=models.ExampleInterfacesFibonacciGoalInput(order=101)
            )
            state = await module("api.actions.get_goal_open_count").asyncio(
                goal_id=goal.id, client=robot_client
            )
            assert state.state == "executing"
    finally:
        for name in [name for name in sys.modules if name.startswith("generated_robot")]:
            del sys.modules[name]


@pytest.mark.extended
@pytest.mark.timeout(300)  # The generators are programs of their own.
async def test_a_generated_client_in_typescript_works(
    described: Path, client: httpx.AsyncClient, robot: Robot
) -> None:
    if shutil.which("node") is None or not (NODE / "node_modules").is_dir():
        pytest.skip("Node and `npm ci --prefix tests/extensions/http/node` are needed")
    folder = described.parent
    (folder / "node_modules").symlink_to(NODE / "node_modules")
    (folder / "package.json").write_text('{"type": "module"}')
    shutil.copy(NODE / "program.ts", folder)
    commands = (
        ["openapi-typescript", str(described), "-o", "robot.ts"],
        ["tsc", "--strict", "--module", "nodenext", "--target", "es2022", "--skipLibCheck", "program.ts"],
    )
    for command in commands:
        await run([str(NODE / "node_modules" / ".bin" / command[0]), *command[1:]], folder)
    base = str(client.base_url).rstrip("/")
    said = await run(["node", "program.js", base], folder)
    assert said.split("\n")[:4] == ["the open", "42", "204", "executing"]
    heard: Any = robot.heard[0]
    assert heard.angular.z == -0.5


async def run(command: list[str], folder: Path) -> str:
    """Return the output of a program; fails if its exit code is not 0."""
    done = await anyio.run_process(command, cwd=folder, check=False)
    assert done.returncode == 0, (done.stdout + done.stderr).decode()
    return done.stdout.decode()
