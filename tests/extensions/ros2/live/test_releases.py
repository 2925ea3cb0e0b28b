"""The release of the installed ROS 2: its name for clients, and its definitions."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing

import anyio.to_thread
import pytest

from rwt_client import connect
from rwt_interfaces import Registry
from tests.extensions.ros2.live.test_server import serving
from tests.statements import Program
from tests.waiting import until_answered

pytestmark = pytest.mark.anyio


def _hashes() -> Iterator[tuple[str, str]]:
    """Each type of the installed packages, and its hash in the JSON that the release installs."""
    from rwt.extensions.ros2.ament import package_folders

    for folder in package_folders():
        for file in sorted(folder.glob("*/*.json")):
            for entry in json.loads(file.read_text("utf-8")).get("type_hashes", ()):
                yield entry["type_name"], entry["hash_string"]


def test_the_standard_definitions_have_the_hashes_of_the_installed_packages() -> None:
    from rwt.extensions.ros2.ament import installed_release

    registry = Registry(installed_release())
    known = {kind: set(registry.names(kind)) for kind in ("msg", "srv")}
    compared, wrong = 0, []
    for name, expected in _hashes():
        package, kind, short = name.split("/")
        own = f"{package}/{short}"
        if kind == "msg" and package != "test_msgs":
            found = registry.message(own).rihs01 if own in known["msg"] else "unknown"
        elif kind == "srv" and own in known["srv"]:
            found = registry.service(own).rihs01
        else:
            continue
        compared += 1
        if found != expected:
            wrong.append((name, found, expected))
    assert wrong == []
    assert compared > 150


async def test_the_doctor_says_that_only_the_server_is_there(domain: int) -> None:
    with serving() as (_, url):

        def examine() -> tuple[str, str]:
            doctor = subprocess.run(
                [sys.executable, "-c", "from rwt.cli import main; main()", "doctor", url, "--json"],
                capture_output=True,
                text=True,
                check=False,
                timeout=60,
            )
            findings = json.loads(doctor.stdout)["findings"]
            (found,) = (each for each in findings if each["name"] == "robot")
            return found["verdict"], found["text"]

        verdict, text = await anyio.to_thread.run_sync(examine)
        assert verdict == "warning", text
        assert text.startswith("only the server itself is there, on ROS 2 ")
        assert f"(domain {domain}, rmw_fastrtps_cpp, discovery range LOCALHOST, programs of this host" in text
        environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
        with closing(
            Program(sys.executable, "tests.extensions.ros2.live.program", environment=environment)
        ) as robot:
            robot.run("")

            async def is_seen() -> bool:
                return (await anyio.to_thread.run_sync(examine))[0] == "ok"

            await until_answered(is_seen)


async def test_clients_are_told_the_installed_release() -> None:
    from rwt.extensions.ros2.ament import installed_release

    with serving() as (_, url):
        async with connect(url) as robot:
            found = await robot.api.ros_version()
            assert (found.version, found.distro) == (2, installed_release().name)
            assert robot.types.distro is installed_release()
