"""A real ROS 1 program in another process, which runs the statements that tests give it.

It runs on the Python of the system, for which Debian packages ROS 1, and imports nothing of this project.
"""

from __future__ import annotations

import base64
import json
import subprocess
import sys
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

NODE: Final = "/robot/program"

#: Prefix of the lines that are answers; ROS prints others.
_ANSWER: Final = "answer: "


class Program:
    """A process with `rospy`. Statements see `rospy` and `plain`.

    Args:
        environment: environment of the process.
        node: name of its node in its namespace.
    """

    def __init__(self, environment: Mapping[str, str], node: str) -> None:
        self.process = subprocess.Popen(
            ["/usr/bin/python3", str(Path(__file__)), node],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )

    def run(self, statements: str) -> Any:
        """Run statements in the program; return the value that they give to `result`, if any.

        Raises:
            RuntimeError: they failed there; the text is the traceback.
        """
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(statements) + "\n")
        self.process.stdin.flush()
        line = ""
        while not line.startswith(_ANSWER):
            line = self.process.stdout.readline()
            if not line:
                raise RuntimeError("the program has ended")
        answer = json.loads(line.removeprefix(_ANSWER))
        if "failed" in answer:
            raise RuntimeError(answer["failed"])
        return answer["result"]

    def kill(self) -> None:
        """End the process without a farewell."""
        self.process.kill()
        self.process.wait()

    def close(self) -> None:
        """End the process."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.kill()
        self.process.stdout.close()


def plain(value: Any) -> Any:
    """Return a message of `rospy` as rosbridge's JSON has it."""
    if hasattr(value, "_slot_types"):
        fields = zip(value.__slots__, value._slot_types, strict=True)
        return {name: _field(getattr(value, name), kind) for name, kind in fields}
    if hasattr(value, "secs"):
        return {"secs": value.secs, "nsecs": value.nsecs}
    if isinstance(value, float) and (value != value or abs(value) == float("inf")):
        return None
    return value


def _field(value: Any, kind: str) -> Any:
    if kind.startswith(("uint8[", "char[")):
        return base64.b64encode(bytes(value)).decode()
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return plain(value)


def main() -> None:
    """Run statements from standard input until it ends."""
    import rospy

    rospy.init_node(sys.argv[1], disable_signals=True)
    scope: dict[str, Any] = {"rospy": rospy, "plain": plain}
    for line in sys.stdin:
        scope["result"] = None
        try:
            exec(json.loads(line), scope)
            answer = {"result": scope["result"]}
        except Exception:
            answer = {"failed": traceback.format_exc()}
        sys.stdout.write(_ANSWER + json.dumps(answer) + "\n")
        sys.stdout.flush()
    rospy.signal_shutdown("the test is over")


if __name__ == "__main__":
    main()
