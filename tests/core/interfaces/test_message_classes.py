"""The standard messages as classes: what type checkers know of them is what they are."""

from __future__ import annotations

import ast
import importlib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import msgspec
import pytest
from mypy import api as mypy

from rwt import Server
from rwt_interfaces import JAZZY, NOETIC, Distro, jazzy, noetic
from tools import generate_message_stubs

ROOT = Path(__file__).parents[3]
MODULES: dict[str, ModuleType] = {"jazzy": jazzy, "noetic": noetic}


@pytest.mark.parametrize("distro", (JAZZY, NOETIC), ids=lambda distro: str(distro.name))
def test_the_stubs_are_current(distro: Distro) -> None:
    written = (generate_message_stubs.TARGET / f"{distro.name}.pyi").read_text(encoding="utf-8")
    assert written == generate_message_stubs.stubs(distro), "run python tools/generate_message_stubs.py"


def _messages(body: list[ast.stmt], within: object) -> Iterator[tuple[ast.ClassDef, object]]:
    """Each message that a stub declares, and what the module has by that name."""
    for declared in body:
        if isinstance(declared, ast.ClassDef):
            found = getattr(within, declared.name)
            if declared.bases:
                yield declared, found
            else:
                yield from _messages(declared.body, found)


@pytest.mark.parametrize("name", MODULES)
def test_what_is_declared_is_there_with_its_fields_and_constants(name: str) -> None:
    tree = ast.parse((generate_message_stubs.TARGET / f"{name}.pyi").read_text(encoding="utf-8"))
    count = 0
    for declared, found in _messages(tree.body, MODULES[name]):
        assert isinstance(found, type) and issubclass(found, msgspec.Struct), declared.name
        members = [each for each in declared.body if isinstance(each, ast.AnnAssign)]
        names = {"fields": [], "constants": []}  # type: dict[str, list[str]]
        for member in members:
            names["fields" if member.value is not None else "constants"].append(ast.unparse(member.target))
        assert list(found.__struct_fields__) == names["fields"], declared.name
        for constant in names["constants"]:
            assert type(getattr(found, constant)).__name__ in ("int", "float", "str", "bool")
        assert found() == found()
        count += 1
    assert count > 400


def test_a_name_that_is_not_there_is_named_with_the_nearest() -> None:
    with pytest.raises(AttributeError, match="did you mean geometry_msgs/Twist"):
        _ = jazzy.geometry_msgs.Twits  # type: ignore[attr-defined]  # the mistake under test
    with pytest.raises(ImportError, match="geometry_msg"):
        exec("from rwt_interfaces.jazzy import geometry_msg")
    with pytest.raises(AttributeError, match="jazzy has no package 'geometry_msg' in the standard set"):
        _ = jazzy.geometry_msg  # type: ignore[attr-defined]  # the mistake under test
    assert importlib.import_module("rwt_interfaces.noetic").Time(secs=1).secs == 1


PROGRAM = """
from rwt import BlockingNode
from rwt_interfaces.jazzy import diagnostic_msgs, example_interfaces, geometry_msgs, sensor_msgs

heard: list[float] = []

def drive(twist: geometry_msgs.Twist) -> None:
    heard.append(twist.linear.x)

def add(request: example_interfaces.AddTwoInts.Request) -> example_interfaces.AddTwoInts.Response:
    return example_interfaces.AddTwoInts.Response(sum=request.a + request.b)

def program(robot: BlockingNode) -> tuple[int, list[float], float, int]:
    robot.subscribe("/cmd_vel", drive, "geometry_msgs/Twist")
    robot.advertise_service("/add", "example_interfaces/AddTwoInts", add)
    request = example_interfaces.AddTwoInts.Request(a=1, b=2)
    answer: example_interfaces.AddTwoInts.Response = robot.call("/add", request)
    robot.publish("/cmd_vel", geometry_msgs.Twist(linear=geometry_msgs.Vector3(x=0.5)))
    scan = sensor_msgs.LaserScan(ranges=[1.0, 2.0])
    scan.header.frame_id = "laser"
    robot.publish("/scan", scan, latch=True)
    seen: sensor_msgs.LaserScan = robot.once("/scan", timeout=60)
    return answer.sum, heard, max(seen.ranges), diagnostic_msgs.DiagnosticStatus.WARN
"""
MISTAKES = {
    "answer.sum,": ('"Response" has no attribute "sun"', "answer.sun,"),
    "x=0.5": ('Argument "x" to "Vector3" has incompatible type "str"', 'x="fast"'),
    "a=1, b=2": ('Unexpected keyword argument "c"', "a=1, c=2"),
    "twist.linear.x": ('"Vector3" has no attribute "left"', "twist.linear.left"),
}


def test_a_program_with_these_classes_runs() -> None:
    names: dict[str, object] = {"__name__": "program"}
    exec(PROGRAM, names)
    program = names["program"]
    assert callable(program)
    with Server("ws://127.0.0.1:0") as robot:
        assert program(robot) == (3, [0.5], 2.0, 1)


@pytest.mark.timeout(700)  # It reads all packages, where none has seen them yet.
def test_a_type_checker_finds_its_mistakes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MYPYPATH", str(ROOT / "src"))
    (tmp_path / "right.py").write_text(PROGRAM, encoding="utf-8")
    wrong = []
    for number, (right, (_, instead)) in enumerate(MISTAKES.items()):
        assert right in PROGRAM
        wrong.append(tmp_path / f"wrong{number}.py")
        wrong[-1].write_text(PROGRAM.replace(right, instead), encoding="utf-8")
    options = ["--strict", f"--cache-dir={tmp_path / 'cache'}", "--config-file="]
    told, _, _ = mypy.run([*options, str(tmp_path / "right.py"), *map(str, wrong)])
    complaints = sorted(line for line in told.splitlines() if ": error:" in line)
    assert len(complaints) == len(MISTAKES), told
    for path, (text, _), complaint in zip(wrong, MISTAKES.values(), complaints, strict=True):
        assert path.name in complaint
        assert text in complaint
