"""The same program texts as a node, as a client in process and over a socket, awaited and blocking."""

from __future__ import annotations

import ast
import inspect
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from functools import partial
from typing import Any

import anyio
import pytest

from rwt import Server, Settings
from rwt.access.access import Access
from rwt.delivery.shared_graph import SharedGraph
from rwt.extensions.mcp.client_robot import ClientRobot
from rwt.rosapi import Rosapi
from rwt_client.blocking import BlockingRobot, connect
from rwt_client.robot import Robot
from rwt_graph import MemoryGraph, Node
from rwt_graph.nodes.blocking import BlockingGraphNode
from rwt_participant.api import RobotApi
from rwt_participant.errors import ParameterRejected, ServiceFailed
from rwt_participant.goals import ReceivedGoal
from tests.contract.program import texts
from tests.core.client.worlds import world

PROGRAMS = sorted({*texts.GIVES, *texts.RAISES})


def make_world(node: Node) -> None:
    """Result of the programs."""

    def broken(request: Any) -> None:
        raise ServiceFailed("it is broken")

    async def silent(request: Any) -> None:
        await anyio.sleep_forever()

    async def fibonacci(goal: ReceivedGoal) -> dict[str, object]:
        sequence = [0]
        for _ in range(goal.request.order - 1):
            goal.publish_feedback({"sequence": sequence})
            sequence = [*sequence, sum(sequence[-2:]) or 1]
        return {"sequence": sequence}

    def check(speed: object) -> None:
        if speed == 9.0:
            raise ParameterRejected("too fast for this floor")

    node.advertise_service("~/add", texts.ADD, lambda request: {"sum": request.a + request.b})
    node.advertise_service("~/silent", "std_srvs/Trigger", silent)
    node.advertise_service("~/broken", "std_srvs/Trigger", broken)
    node.advertise_action("~/fibonacci", texts.FIBONACCI, fibonacci, accept=lambda goal: goal.order < 50)
    node.advertise_action("~/idle", texts.FIBONACCI, silent)
    node.publish("~/level", {"data": 12}, "std_msgs/Int32", latch=True)
    node.parameters.declare("speed", 0.5, on_change=check)
    place = {"translation": {"x": 1.0, "y": 2.0, "z": 3.0}, "rotation": {"w": 1.0}}
    frames = {"header": {"frame_id": "map"}, "child_frame_id": "base", "transform": place}
    node.publish("/tf_static", {"transforms": [frames]}, "tf2_msgs/TFMessage", latch=True)


@asynccontextmanager
async def as_node() -> AsyncIterator[RobotApi]:
    async with MemoryGraph() as graph:
        make_world(Node(graph, "world"))
        yield Node(graph, "program", timeout=texts.PATIENCE)


@asynccontextmanager
async def as_client(transport: str) -> AsyncIterator[RobotApi]:
    async with world(transport) as it:
        make_world(Node(it.graph, "world"))
        yield it.robot


@asynccontextmanager
async def as_view() -> AsyncIterator[RobotApi]:
    """The graph as one client may see it, which is the robot of an agent's tools."""
    async with MemoryGraph() as graph:
        make_world(Node(graph, "world"))
        with Rosapi(graph):
            access = Access(graph, Settings())
            shared = SharedGraph(graph, "/agents", 0.0, print)
            robot = ClientRobot(
                graph, access.client(shared, access.admission.roles["admin"], "127.0.0.1"), "/agents"
            )
            yield robot
            robot.close()
            shared.close()


FACES: dict[str, Any] = {
    "node": as_node,
    "view": as_view,
    "client-memory": partial(as_client, "memory"),
    "client-ws": partial(as_client, "ws"),
}


@pytest.mark.anyio
@pytest.mark.parametrize("face", FACES)
@pytest.mark.parametrize("program", PROGRAMS)
async def test_awaited(program: str, face: str) -> None:
    make: AbstractAsyncContextManager[RobotApi] = FACES[face]()
    async with make as robot:
        run = getattr(texts, program)
        if program in texts.GIVES:
            assert await run(robot) == texts.GIVES[program]
            return
        error, text = texts.RAISES[program]
        with pytest.raises(error) as caught:
            await run(robot)
        assert text in str(caught.value)


class _WithoutAwaits(ast.NodeTransformer):
    """Takes out what is asynchronous, but not of the functions within functions: those run on the loop."""

    def __init__(self) -> None:
        self._inside = False

    def visit_AsyncFunctionDef(self, node: ast.AsyncFunctionDef) -> ast.AST:
        if self._inside:
            return node
        self._inside = True
        self.generic_visit(node)
        self._inside = False
        fields: dict[str, Any] = dict(ast.iter_fields(node))
        return ast.FunctionDef(**fields)

    def visit_Await(self, node: ast.Await) -> ast.AST:
        return self.generic_visit(node.value)

    def visit_AsyncWith(self, node: ast.AsyncWith) -> ast.AST:
        self.generic_visit(node)
        return ast.With(items=node.items, body=node.body)

    def visit_AsyncFor(self, node: ast.AsyncFor) -> ast.AST:
        self.generic_visit(node)
        return ast.For(target=node.target, iter=node.iter, body=node.body, orelse=node.orelse)

    def visit_comprehension(self, node: ast.comprehension) -> ast.AST:
        node.is_async = 0
        return self.generic_visit(node)


def _blocking_texts() -> dict[str, Any]:
    tree = ast.fix_missing_locations(_WithoutAwaits().visit(ast.parse(inspect.getsource(texts))))
    found: dict[str, Any] = {"__name__": "blocking_texts"}
    exec(compile(tree, "blocking_texts", "exec"), found)
    return found


BLOCKING = _blocking_texts()


@pytest.fixture(scope="module")
def blocking_node() -> Iterator[Any]:
    with Server("ws://127.0.0.1:0") as robot:
        make_world(robot.server.node("world"))
        yield robot


@pytest.fixture(scope="module")
def blocking_client(blocking_node: Any) -> Iterator[Any]:
    with connect(blocking_node.server.urls[0]) as robot:
        yield robot


@pytest.mark.parametrize("face", ["blocking_node", "blocking_client"])
@pytest.mark.parametrize("program", PROGRAMS)
def test_blocking(program: str, face: str, request: pytest.FixtureRequest) -> None:
    robot, run = request.getfixturevalue(face), BLOCKING[program]
    if program in texts.GIVES:
        assert run(robot) == texts.GIVES[program]
        return
    error, text = texts.RAISES[program]
    with pytest.raises(error) as caught:
        run(robot)
    assert text in str(caught.value)


SIDES: tuple[type[RobotApi], ...] = (Node, Robot, ClientRobot)
VERBS = dict(inspect.getmembers(RobotApi, inspect.isfunction))


def _positional(verb: Callable[..., object]) -> list[str]:
    parameters = inspect.signature(verb).parameters.values()
    return [each.name for each in parameters if each.kind is each.POSITIONAL_OR_KEYWORD]


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("name", [name for name in VERBS if name[0] != "_"])
def test_the_arguments_of_a_verb_come_in_one_order(name: str, side: type[RobotApi]) -> None:
    verb = getattr(side, name)
    assert _positional(verb) == _positional(VERBS[name])
    assert inspect.iscoroutinefunction(verb) == inspect.iscoroutinefunction(VERBS[name])


@pytest.mark.parametrize("side", [*SIDES, BlockingGraphNode, BlockingRobot])
@pytest.mark.parametrize("name", [name for name in VERBS if name[0] != "_"])
def test_the_help_of_a_verb_is_that_of_every_robot_or_names_it(name: str, side: type) -> None:
    text = inspect.getdoc(getattr(side, name)) or ""
    assert text == inspect.getdoc(VERBS[name]) or ":meth:`" in text
