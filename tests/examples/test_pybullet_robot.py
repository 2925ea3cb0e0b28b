"""`examples/pybullet_robot.py` as a program: over real sockets, in real time, until Ctrl-C."""

from __future__ import annotations

import io
import subprocess
import sys
import time
from collections.abc import Iterator
from http import HTTPStatus
from urllib.error import HTTPError
from urllib.request import urlopen
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from PIL import Image

from rwt_client.blocking import BlockingRobot, connect
from tests.docs.blocks import ROOT
from tests.docs.processes import Running, commands_folder
from tests.processes import free_port

pytest.importorskip("pybullet", reason="PyBullet has wheels for Linux only")

_PROGRAM = ROOT / "examples" / "pybullet_robot.py"
_ACTION = "/xarm6_traj_controller/follow_joint_trajectory"
_PATIENCE = 60.0

pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope="module")
def port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Of the program, which must end well when it is interrupted."""
    folder = tmp_path_factory.mktemp("pybullet_robot")
    port = free_port()
    command = [sys.executable, str(_PROGRAM), f"ws://127.0.0.1:{port}", "--size", "160x120"]
    with Running(command, folder, commands_folder(folder / "commands"), limit=300) as program:
        program.wait_for(f"a Husky with an xArm 6 is at ws://127.0.0.1:{port}")
        yield port
        program.interrupt()
        program.expect_end()


@pytest.fixture
def robot(port: int) -> Iterator[BlockingRobot]:
    with connect(f"ws://127.0.0.1:{port}") as robot:
        yield robot


def fetch(port: int, path: str) -> bytes:
    """Return the content of `path`, requested again while a busy machine has no picture yet."""
    gives_up = time.monotonic() + _PATIENCE
    while True:
        try:
            with urlopen(f"http://127.0.0.1:{port}{path}", timeout=_PATIENCE) as response:
                body: bytes = response.read()
        except HTTPError as error:
            if error.code != HTTPStatus.GATEWAY_TIMEOUT or time.monotonic() > gives_up:
                raise
        else:
            return body


def test_its_meshes_load_over_http(port: int, robot: BlockingRobot) -> None:
    urdf = robot.once("/robot_description", "std_msgs/String", timeout=_PATIENCE).data
    meshes = {mesh.get("filename", "") for mesh in ET.fromstring(urdf).iter("mesh")}
    visual = sorted(mesh for mesh in meshes if mesh.lower().endswith(".stl"))
    assert len(visual) >= 12
    for mesh in visual:
        stl = fetch(port, f"/packages/{mesh.removeprefix('package://')}")
        assert len(stl) == 84 + 50 * int.from_bytes(stl[80:84], "little"), mesh


def test_a_picture_has_the_robots_colours_in_it(port: int) -> None:
    picture = Image.open(io.BytesIO(fetch(port, "/snapshot?topic=/camera/image_raw&type=png")))
    assert picture.size == (160, 120)
    red, green, blue = np.moveaxis(np.asarray(picture.convert("RGB"), int), 2, 0)
    for name, mask in {
        "the arm's blue": (blue > 1.5 * green) & (green > 1.5 * red),
        "the arm's yellow": (red > 1.1 * green) & (green > 2 * blue),
        "the red block": (red > 3 * green) & (red > 3 * blue),
        "the green block": (green > 3 * red) & (green > 3 * blue),
    }.items():
        assert mask.sum() > 30, name


def test_the_depth_cloud_is_a_picture_of_four_tiles(port: int) -> None:
    picture = Image.open(io.BytesIO(fetch(port, "/snapshot?topic=/depthcloud_encoded&type=png")))
    assert picture.size == (1024, 1024)
    assert len(set(picture.crop((0, 0, 512, 512)).convert("L").tobytes())) > 20


def test_it_drives(robot: BlockingRobot) -> None:
    with robot.topic("/odom", "nav_msgs/Odometry") as odometry:
        start = odometry.get(timeout=_PATIENCE).pose.pose.position.x
        for message in odometry:
            robot.publish("/cmd_vel", {"linear": {"x": 0.6}}, "geometry_msgs/Twist")
            if message.pose.pose.position.x > start + 0.2:
                break


def test_the_arm_reaches_a_goal(robot: BlockingRobot) -> None:
    names = [f"joint{number}" for number in range(1, 7)]
    wanted = [0.3, -0.7, -0.9, 0.0, 1.4, 0.2]
    point = {"positions": wanted, "time_from_start": {"sec": 0, "nanosec": 500_000_000}}
    goal = robot.send_goal(_ACTION, {"trajectory": {"joint_names": names, "points": [point]}})
    assert goal.result(timeout=_PATIENCE).result.error_code == 0
    state = robot.once("/joint_states", "sensor_msgs/JointState", timeout=_PATIENCE)
    positions = dict(zip(state.name, state.position, strict=True))
    assert [positions[name] for name in names] == pytest.approx(wanted, abs=0.05)


def _ended(before: str) -> subprocess.CompletedProcess[str]:
    """The program with a URL that cannot be, after a line of Python."""
    code = f"import runpy, sys; sys.argv = ['x', 'nowhere']; {before}; "
    return subprocess.run(
        [sys.executable, "-c", f"{code}runpy.run_path({str(_PROGRAM)!r}, run_name='__main__')"],
        env={"PYTHONPATH": f"{ROOT / 'src'}:{ROOT / 'examples'}"},
        capture_output=True,
        text=True,
        timeout=_PATIENCE,
        check=False,
    )


@pytest.mark.parametrize(
    ("before", "said"),
    [
        ("sys.modules['pybullet_data'] = sys.modules['pybullet'] = None", "pip install pybullet"),
        ("pass", "cannot listen on 'nowhere'"),
    ],
    ids=["without PyBullet", "without an address"],
)
def test_what_it_cannot_start_with_is_one_line(before: str, said: str) -> None:
    done = _ended(before)
    assert (done.returncode, "Traceback" in done.stderr, said in done.stderr) == (1, False, True)
