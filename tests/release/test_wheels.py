"""Reproducible builds, and their use in an environment without other packages."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from tests.docs.blocks import ROOT, blocks_of
from tools.build_release import build_release

OFFLINE = Path(__file__).parent / "programs" / "offline.py"
UNSHARE = ["unshare", "--map-root-user", "--net"]

pytestmark = pytest.mark.timeout(600)

SERVER = """\
import sys
from rwt import Server

server = Server("ws://127.0.0.1:0")
with server as robot:
    robot.advertise_service("/beep", "std_srvs/Trigger", lambda _: {"success": True})
    print(server.urls[0], flush=True)
    sys.stdin.read()
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a whole release; building it compares two builds and checks them."""
    out = tmp_path_factory.mktemp("release") / "dist"
    build_release(out, installed_by_npm())
    return out


def installed_by_npm() -> Path | None:
    """Return the packages that npm has installed for tests of the page, if they match the lock file."""
    folder = ROOT / "web" / "node_modules"
    done = folder / ".package-lock.json"
    if not done.exists():
        return None
    has = json.loads(done.read_bytes())["packages"]
    lock = subprocess.run(
        ["git", "show", "HEAD:web/package-lock.json"], cwd=ROOT, capture_output=True, check=True
    )
    named = {name: package for name, package in json.loads(lock.stdout)["packages"].items() if name}
    missing = named.keys() - has.keys()
    same = all(named.get(name, {}).get("integrity") == package["integrity"] for name, package in has.items())
    return folder if same and all(named[name].get("optional") for name in missing) else None


@pytest.fixture(scope="module")
def bare(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs of a new environment in which both wheels are installed, and what they need."""
    folder = tmp_path_factory.mktemp("bare") / "env"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    wheels = [str(wheel) for wheel in built.glob("*.whl")]
    pip = [sys.executable, "-m", "pip", "--python", str(folder / "bin" / "python"), "install", "--quiet"]
    # What nobody imports here needs no bytecode.
    subprocess.run([*pip, "--no-compile", *wheels], check=True)
    return folder / "bin"


def run(program: Path, *arguments: str, folder: Path) -> str:
    """Return the output of a program in the bare environment, without the repository on its path."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    command = [str(program), *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_release_is_complete(built: Path) -> None:
    names = {re.sub(r"-[\d.]+\d", "", file.name) for file in built.iterdir()}
    projects = (
        "robot_web_tools rwt_webrtc rwt_rclpy rwt_lerobot rwt_mavlink lerobot_robot_rosbridge"
        " rosbridge_conformance"
    )
    files = {f"{name}{end}" for name in projects.split() for end in ("-py3-none-any.whl", ".tar.gz")}
    assert names == files | {"robot-web-tools-widgets.tgz", "SHA256SUMS"}


def test_licence_comes_along(bare: Path, tmp_path: Path) -> None:
    program = (
        "from importlib.metadata import metadata\n"
        "ours = ('robot-web-tools', 'rwt-webrtc', 'rwt-rclpy', 'rwt-lerobot', 'rwt-mavlink',\n"
        "        'rosbridge-conformance')\n"
        "for name in ours:\n"
        "    found = metadata(name)\n"
        "    print(name, found['License-Expression'], *sorted(found.get_all('License-File')))\n"
    )
    server, *others = run(bare / "python", "-c", program, folder=tmp_path).splitlines()
    assert server == "robot-web-tools BSD-3-Clause LICENSE NOTICE"
    assert [line.partition(" ")[2] for line in others] == ["BSD-3-Clause LICENSE"] * 5


def test_licences_of_the_scripts_of_others_come_along(built: Path) -> None:
    (wheel,) = built.glob("robot_web_tools-*.whl")
    with zipfile.ZipFile(wheel) as opened:
        names = opened.namelist()
        of_bundles = opened.read("rwt/extensions/dashboard/static/web/licenses.txt").decode()
    copied = {re.sub(r"-[\d.]+txt$", "", Path(name).name) for name in names if "/lib/licenses/" in name}
    assert copied >= {"roslib", "ros2d", "ros3d", "three", "easeljs", "eventemitter2"}
    parts = of_bundles.split(f"\n{'-' * 80}\n")
    titles = [part.strip().splitlines()[0] for part in parts]
    assert {title.split()[0] for title in titles} >= {"preact", "three", "roslib", "uplot", "urdf-loader"}
    permissive = r"\S+ [\d.]+ \((MIT|ISC|BSD-[23]-Clause|Apache-2\.0|OFL-1\.1)\)"
    assert [title for title in titles if not re.fullmatch(permissive, title)] == []
    (package,) = built.glob("*.tgz")
    with tarfile.open(package) as packed:
        text = packed.extractfile("package/licenses.txt")
        assert text is not None and text.read().decode() == of_bundles


def test_server_command_line_and_suite_work_from_the_wheels(bare: Path, tmp_path: Path) -> None:
    (tmp_path / "robot.py").write_text(SERVER)
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    command = [str(bare / "python"), "robot.py"]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, cwd=tmp_path, env=environment, stdin=pipe, stdout=pipe, text=True
    ) as server:
        assert server.stdin is not None and server.stdout is not None
        url = server.stdout.readline().strip()
        answer = run(bare / "rwt", "service", "call", "--url", url, "/beep", "{}", folder=tmp_path)
        grade = run(bare / "rosbridge-conformance", url, "--run", "services/*", folder=tmp_path)
        server.stdin.close()
        assert server.wait() == 0
    assert "success" in answer
    assert re.search(r"\d+ pass", grade)


def test_a_node_runs_from_the_wheels(bare: Path, tmp_path: Path) -> None:
    (tmp_path / "node.py").write_text(
        "import rclpy\nrclpy.init()\nprint(rclpy.create_node('n').get_name())\n"
    )
    assert run(bare / "rwt", "run", "node.py", folder=tmp_path) == "n\n"


@pytest.mark.slow
def test_what_the_readme_shows_works_from_the_wheels_without_a_network(bare: Path, tmp_path: Path) -> None:
    if shutil.which("unshare") is None:
        pytest.skip("there is no unshare, which makes a network namespace")
    tried = subprocess.run([*UNSHARE, "true"], capture_output=True, text=True)
    if tried.returncode != 0:
        pytest.skip(f"no network namespace can be made here: {tried.stderr.strip()}")
    readme = [block for block in blocks_of(ROOT / "README.md") if block.language == "python"]
    for block in readme:
        name = {"client": "client.py", "server": "robot.py"}[block.value("run")]
        (tmp_path / name).write_text(block.code, encoding="utf-8")
    unshare, *options = UNSHARE
    said = run(Path(unshare), *options, str(bare / "python"), str(OFFLINE), str(bare), folder=tmp_path)
    for text in (*(text for block in readme for text in block.values("prints")), "grade A+", "beep"):
        assert text in said
