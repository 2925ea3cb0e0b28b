"""`--cafile` and `--insecure`: commands against a server whose certificate no authority has signed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from rwt import Server
from tests.contract.transports.test_listen import certificate as certificate
from tests.core.cli.conftest import Rwt


@pytest.fixture
def encrypted(certificate: Path) -> Iterator[str]:
    tls = {"certfile": certificate, "keyfile": certificate}
    with Server("wss://127.0.0.1:0", tls=tls, demo=True) as robot:
        yield robot.server.urls[0]


def test_a_certificate_is_checked_against_the_file_that_is_named(
    rwt: Rwt, encrypted: str, certificate: Path, tmp_path: Path
) -> None:
    there = ("topic", "type", "/odom", "--url", encrypted)
    assert rwt(*there).code == 3
    assert rwt(*there, "--cafile", str(certificate)).out == "nav_msgs/msg/Odometry\n"
    assert rwt(*there, "--insecure").out == "nav_msgs/msg/Odometry\n"
    recorded = ("/odom", "--max-seconds", "0.1", "-o", str(tmp_path / "a.mcap"))
    assert rwt("bag", "record", *recorded, "--url", encrypted).code == 3
    assert rwt("bag", "record", *recorded, "--url", encrypted, "--cafile", str(certificate)).code == 0


def test_the_doctor_asks_for_the_file_and_takes_it(rwt: Rwt, encrypted: str, certificate: Path) -> None:
    ended = rwt("doctor", encrypted)
    assert (ended.code, "--cafile" in ended.out) == (3, True)
    ended = rwt("doctor", encrypted, "--cafile", str(certificate))
    assert ended.code == 0
    assert ended.out.startswith("ok       server: rwt ")
