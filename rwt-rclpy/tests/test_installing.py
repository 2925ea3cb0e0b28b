"""Imports under ROS's names, and errors of the others."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import rwt_rclpy
from rwt_rclpy.modules import ABSENT, MODULES

NODE = """
import sys
import rclpy
from rclpy.node import Node
from my_msgs.msg import Status

class Talker(Node):
    def __init__(self):
        super().__init__("talker")
        self.count = self.declare_parameter("count", 1).value
        self.publisher = self.create_publisher(Status, "status", 10)
        self.create_subscription(Status, "status", self.heard, 10)
        self.create_timer(0.01, self.talk)

    def talk(self):
        self.publisher.publish(Status(level=self.count))

    def heard(self, message):
        print(self.get_fully_qualified_name(), message, flush=True)
        raise SystemExit

def main(args=None):
    rclpy.init(args=args)
    rclpy.spin(Talker())

if __name__ == "__main__":
    main()
"""
SETUP = """
from setuptools import setup
package_name = "talking"
setup(name=package_name, entry_points={"console_scripts": ["talker = talking.node:main"]})
"""


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    (tmp_path / "my_msgs/msg").mkdir(parents=True)
    (tmp_path / "my_msgs/msg/Status.msg").write_text("int32 level\n")
    package = tmp_path / "src/talking/talking"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "node.py").write_text(NODE)
    (package.parent / "setup.py").write_text(SETUP)
    return tmp_path


def ran(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments], cwd=cwd, capture_output=True, text=True, timeout=100, check=False
    )


EXPECTED = "/home/talker my_msgs.msg.Status(level=5)"
ARGUMENTS = ("--ros-args", "-r", "__ns:=/home", "-p", "count:=5")


def test_a_file_is_run(workspace: Path) -> None:
    path = "src/talking/talking/node.py"
    done = ran("-m", "rwt_rclpy", "--interfaces", "my_msgs", path, *ARGUMENTS, cwd=workspace)
    assert (done.returncode, done.stdout.strip()) == (0, EXPECTED), done.stderr


def test_an_executable_of_a_package_is_run(workspace: Path) -> None:
    done = ran("-m", "rwt.cli", "run", "--interfaces", ".", "talking", "talker", *ARGUMENTS, cwd=workspace)
    assert (done.returncode, done.stdout.strip()) == (0, EXPECTED), done.stderr
    done = ran("-m", "rwt.cli", "run", "talking", "singer", cwd=workspace)
    assert done.returncode == 1 and "it has talker. One in C++ runs on a machine with ROS" in done.stderr


def test_the_source_of_what_is_here_is_left_alone(workspace: Path) -> None:
    """Of a whole checkout of geometry2: its `tf2_ros` imports C++ that nobody has built."""
    source = workspace / "src/tf2_ros_py/tf2_ros"
    source.mkdir(parents=True)
    (source / "__init__.py").write_text("from tf2_py._tf2_py import *")
    (source.parent / "setup.py").write_text(SETUP.replace("talking", "tf2_ros_py"))
    (workspace / "src/talking/talking/node.py").write_text("import tf2_ros\n" + NODE)
    done = ran("-m", "rwt.cli", "run", "--interfaces", ".", "talking", "talker", *ARGUMENTS, cwd=workspace)
    assert (done.returncode, done.stdout.strip()) == (0, EXPECTED), done.stderr


def test_an_installed_ros_is_not_put_aside(tmp_path: Path) -> None:
    (tmp_path / "rclpy").mkdir()
    (tmp_path / "rclpy/__init__.py").write_text("real = True")
    program = "import rwt_rclpy; print(rwt_rclpy.install()); import rclpy; print(rclpy.real)"
    done = ran("-c", program, cwd=tmp_path)
    assert done.stdout.split() == ["ros", "True"], done.stderr


def test_half_a_ros_is_refused(tmp_path: Path) -> None:
    (tmp_path / "std_msgs/msg").mkdir(parents=True)
    (tmp_path / "std_msgs/__init__.py").write_text("")
    done = ran("-c", "import rwt_rclpy; rwt_rclpy.install(); import std_msgs.msg", cwd=tmp_path)
    assert "MixedInstallation" in done.stderr and "source all of ROS" in done.stderr.replace("\n", " ")


def test_nothing_is_imported_before_it_is_asked_for(tmp_path: Path) -> None:
    done = ran("-c", "import rwt_rclpy; import rclpy", cwd=tmp_path)
    assert "No module named 'rclpy'" in done.stderr


@pytest.mark.parametrize("name", sorted(MODULES))
def test_every_module_can_be_imported(name: str) -> None:
    if name == "cv_bridge":
        pytest.importorskip("cv2")
    module = importlib.import_module(name)
    assert module.__name__ == MODULES[name] and sys.modules[name] is module


@pytest.mark.parametrize("name", sorted(ABSENT))
def test_what_is_absent_is_named_with_what_to_do_instead(name: str) -> None:
    with pytest.raises(ImportError, match=r"is not available without ROS: \w"):
        importlib.import_module(name)


def test_nodes_do_not_start_without_the_enclaves_that_are_demanded(monkeypatch: pytest.MonkeyPatch) -> None:
    import rclpy
    from rclpy.context import Context

    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Enforce")
    with pytest.raises(rclpy.exceptions.RCLError, match="enclaves"):
        rclpy.init(args=[], context=Context())
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Permissive")
    context = Context()
    rclpy.init(args=["--ros-args", "--enclave", "/house"], context=context)
    context.shutdown()


def test_which_one_runs() -> None:
    assert rwt_rclpy.installed() == "rwt_rclpy"


def test_an_interface_that_needs_an_unknown_one_says_which(tmp_path: Path) -> None:
    (tmp_path / "msg").mkdir()
    (tmp_path / "package.xml").write_text("<package><name>needy_msgs</name></package>")
    (tmp_path / "msg" / "Whole.msg").write_text("needy_msgs/Absent part\n")
    code = (
        f"import rwt_rclpy; rwt_rclpy.install([{str(tmp_path)!r}])\n"
        "try:\n    from needy_msgs.msg import Whole\nexcept ImportError as error:\n    print(error)"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "needy_msgs.msg.Whole" in said and "Absent" in said
