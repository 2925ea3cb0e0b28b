"""Pages from elsewhere, and credentials that were used before."""

from __future__ import annotations

from pathlib import Path

import pytest

from rwt import Settings
from rwt.access.settings import AuthSettings
from tests.core.rosbridge.test_auth import SECRET, signed
from tests.faults.blocking_client import Refused
from tests.faults.conftest import BRIEF, Robot, Start


@pytest.mark.parametrize("origin", [b"http://evil.example", b"http://localhost.evil.example", b"x"])
def test_a_page_from_elsewhere_is_kept_out(robot: Robot, origin: bytes) -> None:
    with pytest.raises(Refused, match=r"^HTTP/1\.1 403 ") as refused:
        robot.connect(b"Origin: " + origin)
    assert "origins.allow" in str(refused.value)
    with robot.connect(b"Origin: http://localhost:8080") as page:
        page.ask_something()


def test_an_auth_that_was_overheard_is_worth_nothing(start: Start, tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text(SECRET)
    robot = start(Settings(limits=BRIEF, auth=AuthSettings(rosauth_secret_file=secret)))
    overheard = signed()
    with robot.connect() as client, robot.connect() as thief:
        client.say("auth", **overheard)
        client.ask_something()
        thief.say("auth", **overheard)
        code, reason = thief.ending()
        assert code == 1008 and "used before" in reason
        client.ask_something()
