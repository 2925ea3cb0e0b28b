"""The how-to page "A web page for a ROS 1 robot", against a robot whose programs are rospy's."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest

from tests.browser.driver import NODE, find_browser, opened_browser
from tests.extensions.ros1.live.conftest import serving
from tests.processes import free_port
from tests.waiting import until

if TYPE_CHECKING:
    from tests.extensions.ros1.live.conftest import Ros

pytestmark = pytest.mark.anyio

TEXT: Final = (Path(__file__).parents[4] / "docs/how-to/ros1.md").read_text(encoding="utf-8")

ROBOT: Final = """
from std_msgs.msg import String
from geometry_msgs.msg import Twist
chatter = rospy.Publisher('/chatter', String, latch=True, queue_size=1)
chatter.publish('hello from ROS 1')
driven = []
rospy.Subscriber('/cmd_vel', Twist, lambda twist: driven.append([twist.linear.x, twist.angular.z]))
"""


def block(language: str) -> str:
    """Return the first code block of a language on the page."""
    found = re.search(rf"```{language}\n(.*?)```", TEXT, re.DOTALL)
    assert found is not None
    return found[1]


async def test_the_page_works(ros: Ros, tmp_path: Path) -> None:
    kind = find_browser()
    if kind is None or not (NODE / "node_modules").is_dir():
        pytest.skip("needs a browser: see tests/browser/conftest.py")
    robot = ros.program()
    robot.run(ROBOT)
    command = next(line for line in block("sh").splitlines() if line.startswith("rwt "))
    words = shlex.split(command.replace("ros1://robot:11311", ros.uri).replace("0.0.0.0:9090", "127.0.0.1:0"))
    with serving(*words[1:]) as (_, url):
        page = tmp_path / "robot.html"
        address = url.removeprefix("ws://").rstrip("/")
        page.write_text(block("html").replace("127.0.0.1:9090", address), encoding="utf-8")
        port = free_port()
        ros.start(
            "python3", "-m", "http.server", str(port), "--bind", "127.0.0.1", "--directory", str(tmp_path)
        )
        with opened_browser(kind, tmp_path) as browser:
            async with browser.page(f"http://127.0.0.1:{port}/robot.html") as shown:
                await shown.wait("said.value === 'hello from ROS 1'")
                await ros.shows({"/cmd_vel"}, "rostopic", "list")
                await shown.click("#drive")
                await until(lambda: robot.run("result = driven") == [[0.2, 0.5]])
            async with browser.page(f"http://{address}/", 1000, 800) as dashboard:
                await dashboard.wait("document.body.innerText.includes('/chatter')")
