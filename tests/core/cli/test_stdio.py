"""`rwt serve stdio:` as the program that starts it meets it: three pipes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from tests.processes import ended, start

_COMMAND = ("serve", "stdio:")

_NOISY = """
import os, sys, anyio
from rwt import Server
print("printed before")
async def main():
    async with Server("stdio:") as server:
        print("printed in between")
        os.system("echo said by a child")
        assert sys.stdin.read() == ""
        graph_is_up = server.urls == ("stdio:",)
        assert graph_is_up
        await server.ended()
    print("printed after", flush=True)
anyio.run(main)
"""


def test_one_json_stream_each_way_and_nothing_else_on_stdout() -> None:
    pipe = subprocess.PIPE
    with start(*_COMMAND, "--demo", stdin=pipe, stdout=pipe, stderr=pipe) as process:
        assert process.stdin and process.stdout and process.stderr
        assert any(line == "listening on stdio:\n" for line in process.stderr)
        call = {"op": "call_service", "id": "1", "service": "/add_two_ints", "args": {"a": 20, "b": 22}}
        process.stdin.write(json.dumps(call))
        process.stdin.flush()
        answer = json.loads(process.stdout.readline())
        assert (answer["id"], answer["values"]) == ("1", {"sum": 42})
        process.stdin.write('{"op":"subscribe","topic":"/map"}')
        process.stdin.flush()
        assert json.loads(process.stdout.readline())["topic"] == "/map"
        process.stdin.close()
        rest = process.stdout.read()
        assert process.wait(timeout=60) == 0
        assert "Traceback" not in process.stderr.read()
    for line in rest.splitlines():
        json.loads(line)


def test_the_answers_to_what_was_piped_in_are_all_there() -> None:
    calls = "".join(
        json.dumps({"op": "call_service", "id": str(at), "service": "/rosapi/get_time"}) for at in range(20)
    )
    done = ended(*_COMMAND, stdin_text=calls)
    assert done.returncode == 0
    assert [json.loads(line)["id"] for line in done.stdout.splitlines()] == [str(at) for at in range(20)]


def test_input_from_a_file_and_from_nowhere(tmp_path: Path) -> None:
    call = tmp_path / "call.json"
    call.write_text('{"op":"call_service","id":"f","service":"/rosapi/get_time"}')
    with call.open() as file:
        done = ended(*_COMMAND, stdin=file)
    assert json.loads(done.stdout)["id"] == "f"
    nothing = ended(*_COMMAND, stdin=subprocess.DEVNULL)
    assert (nothing.returncode, nothing.stdout) == (0, "")


def test_what_the_program_prints_goes_to_stderr_meanwhile() -> None:
    done = subprocess.run(
        [sys.executable, "-c", _NOISY],
        # What is printed before waits in a buffer.
        env={name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"},
        input='{"op":"call_service","id":"1","service":"/nope"}',
        capture_output=True,
        text=True,
        timeout=20,
        check=True,
    )
    first, after = done.stdout.splitlines()
    assert json.loads(first)["id"] == "1"
    assert after == "printed after"
    for said in ("printed before", "printed in between", "said by a child"):
        assert said in done.stderr


def test_standard_streams_are_served_once() -> None:
    done = ended(*_COMMAND, "stdio:", stdin_text="")
    assert done.returncode == 1
    assert "stdio: can be named once" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
