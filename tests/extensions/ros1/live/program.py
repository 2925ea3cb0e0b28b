"""A real ROS 1 program, which runs statements that see `rospy` and `plain`.

It runs on the Python of the system, for which Debian packages ROS 1, and imports no package of this project.
"""

from __future__ import annotations

import base64
import sys
from typing import Any, Final

from tests.statements import run_statements

NODE: Final = "/robot/program"


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
    run_statements({"rospy": rospy, "plain": plain})
    rospy.signal_shutdown("the test is over")


if __name__ == "__main__":
    main()
