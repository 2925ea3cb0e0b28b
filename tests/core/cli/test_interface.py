"""`rwt interface`: definitions as text, and types that compilers and real messages agree with."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from rwt_interfaces import Payload, Registry
from tests.core.cli.conftest import ROOT, Rwt

_NODE_CLIENTS = ROOT / "tests" / "clients" / "node"
TRICKY = Path(__file__).parent / "tricky_msgs"
"""A package with everything that may go wrong; one of its names is also a standard one."""


def _module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def test_show_comments(rwt: Rwt) -> None:
    there = ("--interfaces", str(TRICKY))
    assert rwt("interface", "show", "tricky_msgs/All", *there).out.startswith("# Every shape")
    assert "#" not in rwt("interface", "show", "tricky_msgs/All", "--no-comments", *there).out


def test_generated_python_satisfies_mypy_and_takes_real_messages(rwt: Rwt, tmp_path: Path) -> None:
    own, live = tmp_path / "own_messages.py", tmp_path / "live_messages.py"
    made = rwt("interface", "generate", "--lang", "python", "--interfaces", str(TRICKY), "-o", str(own))
    assert made.code == 0, made.err
    assert rwt("interface", "generate", "--lang", "python", "--live", "-o", str(live)).code == 0
    user = tmp_path / "user.py"
    user.write_text(
        "import live_messages as live\nimport own_messages as own\n"
        "twist = live.Twist(linear=live.Vector3(x=0.5))\nspeed: float = twist.linear.x\n"
        "everything = own.All(from_='here', point=own.GeometryMsgsPoint(x=1.0))\n"
        "answer: own.Ask_Response = own.Ask.Response()\n"
    )
    _mypy_accepts(own, live, user)
    _real_messages_fit(rwt, _module(live))
    _tricky_messages_fit(_module(own))


def _mypy_accepts(*files: Path) -> None:
    # Without the plugin of pydantic, which users need not have.
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file", "/dev/null", *map(str, files)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=files[0].parent)
    assert done.returncode == 0, done.stdout


def _real_messages_fit(rwt: Rwt, module: ModuleType) -> None:
    for topic, name in (("/odom", "Odometry"), ("/scan", "LaserScan"), ("/map", "OccupancyGrid")):
        text = rwt("topic", "echo", topic, "--once", "--json").out
        message = getattr(module, name).model_validate_json(text)
        assert json.loads(message.model_dump_json()) == json.loads(text)


def _tricky_messages_fit(module: ModuleType) -> None:
    registry = Registry()
    registry.add_directory(TRICKY)
    kind = registry.message("tricky_msgs/All")
    # What the server makes of nothing is what the model makes of nothing.
    wire = json.loads(bytes(Payload.from_value(kind, {}).json()))
    model: Any = module.All()
    assert json.loads(model.model_dump_json()) == wire
    assert (model.SMALL, model.HUGE, model.NAME, model.given) == (-5, 2**64 - 1, 'quo"te', [1, 2, 3])
    given = {**wire, "octets": "AQI=", "from": "there", "three": [1, None, 3]}
    read = module.All.model_validate_json(json.dumps(given))
    assert (read.octets, read.from_) == (b"\x01\x02", "there")
    assert read.three[1] != read.three[1], "null is NaN"
    Payload.from_json(kind, read.model_dump_json().encode())
    for wrong in (
        {"int": 1.5},
        {"four": "AQI="},
        {"few": [1, 2, 3]},
        {"short": "longer"},
        {"letter": 256},
        {"x": 1},
    ):
        with pytest.raises(ValueError, match="validation error"):
            module.All.model_validate(wrong)


@pytest.mark.extended
def test_generated_typescript_satisfies_tsc(rwt: Rwt, tmp_path: Path) -> None:
    compiler = _NODE_CLIENTS / "node_modules" / "typescript" / "bin" / "tsc"
    if not compiler.is_file():
        pytest.fail("TypeScript is not installed: run `npm ci --prefix tests/clients/node`", pytrace=False)
    own, live = tmp_path / "own.ts", tmp_path / "live.ts"
    rwt("interface", "generate", "--lang", "typescript", "--interfaces", str(TRICKY), "-o", str(own))
    rwt("interface", "generate", "--lang", "typescript", "--live", "-o", str(live))
    user = tmp_path / "user.ts"
    user.write_text(
        'import { Twist, MessageTypes } from "./live";\nimport { All, Ask_Request } from "./own";\n'
        'const twist: MessageTypes["geometry_msgs/msg/Twist"] = '
        "{ linear: { x: 1, y: 0, z: 0 }, angular: { x: 0, y: 0, z: 0 } };\n"
        "const same: Twist = twist;\n"
        "const ask: Ask_Request = { question: String(same.linear.x + All.SMALL) };\n"
        "// @ts-expect-error: a number is asked for\nsame.linear.x = ask.question;\n"
    )
    command = ["node", str(compiler), "--strict", "--noEmit", "--target", "es2022", str(user)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=tmp_path)
    assert done.returncode == 0, done.stdout
