"""A real ROS 2 program, which runs statements.

They see `node`, `executor`, `rclpy`, `qos`, `plain` and `String`.
"""

from __future__ import annotations

import threading
from importlib import import_module
from typing import Any, Final

from tests.statements import run_statements

NODE: Final = "/robot/program"


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
    texts = import_module("std_msgs.msg")
    names = {"node": node, "executor": executor, "rclpy": rclpy, "qos": qos, "plain": plain}
    run_statements({**names, "String": texts.String})
    rclpy.shutdown()
    spinning.join()
    executor.shutdown()
    node.destroy_node()


if __name__ == "__main__":
    main()
