"""A real ROS 2 program in another process, which runs the statements that tests give it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import traceback
from typing import Any, Final, Self

NODE: Final = "/robot/program"


class Program:
    """A process with `rclpy`, whose node is :data:`NODE`.

    Statements see `node`, `executor`, `rclpy` and `qos`.
    """

    def __init__(self, domain: int) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
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
        answer = json.loads(self.process.stdout.readline() or '{"failed": "the program has ended"}')
        if "failed" in answer:
            raise RuntimeError(answer["failed"])
        return answer["result"]

    def kill(self) -> None:
        """End the process without a farewell."""
        assert self.process.stdin is not None
        self.process.kill()
        self.process.wait()
        self.process.stdin.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        if self.process.poll() is None:
            self.process.stdin.close()
            self.process.wait(10)
        self.process.stdout.close()


def plain(value: Any) -> Any:
    """Return a message of `rclpy` as what JSON can hold; numbers that it cannot are texts."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return value[0]  # A `byte`; arrays of `uint8` have other types.
    if isinstance(value, str):
        return value
    if hasattr(value, "__len__"):
        return [plain(each) for each in value]
    if isinstance(value, float) and value != value:
        return "nan"
    return value if isinstance(value, bool) else int(value) if float(value).is_integer() else float(value)


def main() -> None:
    """Run statements from standard input until it ends."""
    import rclpy
    from rclpy import qos
    from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor

    rclpy.init()
    namespace, _, name = NODE.rpartition("/")
    node = rclpy.create_node(name, namespace=namespace)
    executor = MultiThreadedExecutor(4)
    executor.add_node(node)

    def spin() -> None:
        try:
            executor.spin()
        except ExternalShutdownException:
            return

    spinning = threading.Thread(target=spin)
    spinning.start()
    scope: dict[str, Any] = {"node": node, "executor": executor, "rclpy": rclpy, "qos": qos, "plain": plain}
    for line in sys.stdin:
        scope["result"] = None
        try:
            exec(json.loads(line), scope)
            answer = {"result": scope["result"]}
        except Exception:
            answer = {"failed": traceback.format_exc()}
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()
    rclpy.shutdown()
    spinning.join()
    executor.shutdown()
    node.destroy_node()


if __name__ == "__main__":
    main()
