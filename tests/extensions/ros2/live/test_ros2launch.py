"""`ros2 launch` and `ros2 run`, where installed, start the server by the package of `rwt ros2 install`."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

import pytest

from tests.processes import free_port
from tests.waiting import wait_until

pytest.importorskip("ros2launch", reason="needs ros2launch and ros2run, of which there are no wheels")

_MAIN = "from ros2cli.cli import main; import sys; sys.exit(main())"


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory, domain: int) -> dict[str, str]:
    prefix = tmp_path_factory.mktemp("prefix")
    subprocess.run([sys.executable, "-m", "rwt.cli", "ros2", "install", str(prefix)], check=True)
    path = f"{prefix}{os.pathsep}{os.environ['AMENT_PREFIX_PATH']}"
    return os.environ | {"AMENT_PREFIX_PATH": path, "ROS_LOG_DIR": str(prefix / "log")}


@pytest.mark.parametrize(
    "command",
    [
        "launch rwt rwt_launch.py port:={port} address:=127.0.0.1 call_services_in_new_thread:=true",
        "run rwt serve --ros-args -p port:={port} -p address:=127.0.0.1",
    ],
)
def test_the_server_starts_and_ends(command: str, environment: dict[str, str], tmp_path: Path) -> None:
    port = free_port()

    def status() -> str | None:
        assert process.poll() is None, (tmp_path / "log").read_text()
        try:
            with urlopen(f"http://127.0.0.1:{port}/healthz", timeout=60) as answer:
                return str(json.load(answer)["status"])
        except URLError:
            return None

    arguments = command.format(port=port).split()
    with (
        (tmp_path / "log").open("w") as log,
        subprocess.Popen(
            [sys.executable, "-c", _MAIN, *arguments],
            stdout=log,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
        ) as process,
    ):
        try:
            wait_until(lambda: status() == "ok")
        finally:
            os.killpg(process.pid, signal.SIGINT)
    assert process.returncode == 0, (tmp_path / "log").read_text()
    assert "Traceback" not in (tmp_path / "log").read_text()
    with pytest.raises(URLError):
        urlopen(f"http://127.0.0.1:{port}/healthz", timeout=60)
