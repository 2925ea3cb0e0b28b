"""The log of the command: its two formats, and what a full disk costs."""

from __future__ import annotations

import errno
import io
import json
import logging
import re
import socket
import sys
from collections.abc import Iterator

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from rwt.access.audit import LOG_LOSSES
from rwt.cli import main
from rwt.cli.console.logs import JsonFormatter, LogfmtFormatter, SteadyHandler, TextFormatter
from tests.processes import running

logger = logging.getLogger("tests.log")


class Disk(io.StringIO):
    """A file on a disk that may be full."""

    full = False

    def write(self, text: str) -> int:
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(text)


@pytest.fixture
def disk() -> Disk:
    return Disk()


@pytest.fixture
def handler(disk: Disk) -> Iterator[SteadyHandler]:
    handler = SteadyHandler(disk)
    handler.setFormatter(JsonFormatter())
    logger.addHandler(handler)
    yield handler
    logger.removeHandler(handler)


def _lines(disk: Disk) -> list[dict[str, object]]:
    return [json.loads(line) for line in disk.getvalue().splitlines()]


@pytest.mark.usefixtures("handler")
def test_a_json_line_has_the_fields_of_its_record(disk: Disk) -> None:
    logger.warning('said "%s"\n', "härter", extra={"client": 7, "op_id": "x"})
    logger.warning("plain", extra={"client": None, "op_id": None})
    first, second = _lines(disk)
    assert str(first.pop("time")).endswith("+00:00")
    assert first == {
        "level": "warning", "logger": "tests.log", "message": 'said "härter"\n', "client": 7, "op_id": "x",
    }  # fmt: skip
    assert "client" not in second and "op_id" not in second


@pytest.mark.parametrize("formatter", [TextFormatter("%(message)s"), JsonFormatter(), LogfmtFormatter()])
def test_no_character_of_a_line_is_unprintable(
    disk: Disk, handler: SteadyHandler, formatter: logging.Formatter
) -> None:
    handler.setFormatter(formatter)
    logger.warning("a\nFORGED \x1b[2J\x9b \u202eb\u2066 \u2028 \U000e0001", extra={"op_id": "\u202e"})
    (line,) = disk.getvalue().split("\n")[:-1]
    assert line.isprintable()
    if isinstance(formatter, JsonFormatter) and not isinstance(formatter, LogfmtFormatter):
        assert json.loads(line)["message"] == "a\nFORGED \x1b[2J\x9b \u202eb\u2066 \u2028 \U000e0001"


def test_a_logfmt_line_quotes_what_is_no_word(disk: Disk, handler: SteadyHandler) -> None:
    handler.setFormatter(LogfmtFormatter())
    logger.warning('said "%s"\n', "härter", extra={"client": 7, "op_id": "publish:/a"})
    (line,) = disk.getvalue().splitlines()
    time, _, rest = line.partition(" ")
    assert time.startswith("time=2") and time.endswith("+00:00")
    assert rest == (r'level=warning logger=tests.log message="said \"härter\"\n" client=7 op_id=publish:/a')


@pytest.mark.usefixtures("handler")
def test_a_traceback_stays_on_its_line(disk: Disk) -> None:
    try:
        raise KeyError("why")
    except KeyError:
        logger.exception("failed")
    (line,) = _lines(disk)
    assert "KeyError: 'why'" in str(line["error"])


def test_a_full_disk_costs_lines_and_says_how_many(
    disk: Disk, handler: SteadyHandler, capsys: pytest.CaptureFixture[str]
) -> None:
    before = LOG_LOSSES.lines
    disk.full = True
    for _ in range(3):
        logger.warning("lost")
    assert handler.lost == 3 and capsys.readouterr().err == ""
    assert (LOG_LOSSES.lines - before, LOG_LOSSES.is_losing) == (3, True)
    disk.full = False
    logger.warning("back")
    assert not LOG_LOSSES.is_losing
    assert [line["message"] for line in _lines(disk)] == ["3 lines of the log were lost", "back"]


def test_the_command_logs_json_with_the_clients_name() -> None:
    with running("serve", "ws://127.0.0.1:0", "--log-format", "json") as (process, url):
        with connect(url) as wire:
            wire.send('{"op":"unsubscribe","topic":"/x","id":"u:1"}')
            wire.send('{"op":"call_service","service":"/nowhere","id":"c:1"}')
            wire.recv(timeout=60)
        process.terminate()
        _, errors = process.communicate(timeout=60)
    lines = [json.loads(line) for line in errors.splitlines()]
    bridge = [line for line in lines if line["logger"] == "rwt.bridge"]
    assert {line["client"] for line in bridge} == {"rosbridge:1"}
    assert {"u:1", "c:1"} <= {line.get("op_id") for line in bridge}


@pytest.mark.skipif(sys.platform != "linux", reason="/dev/full is a Linux device")
def test_the_server_lives_on_when_stderr_is_on_a_full_disk() -> None:
    with (
        open("/dev/full", "w") as full,
        running("serve", "ws://127.0.0.1:0", "-v", stderr=full.fileno()) as (
            _,
            url,
        ),
    ):
        for _ in range(2):
            with connect(url) as wire:
                wire.send("no JSON")
                wire.send('{"op":"call_service","service":"/nowhere","id":"c:1"}')
                assert json.loads(wire.recv(timeout=60))["id"] == "c:1"


def test_the_log_of_a_command_ends_with_it(capsys: pytest.CaptureFixture[str]) -> None:
    before = [*logging.getLogger().handlers]
    assert main(["serve", "--set", "listen=[]"]) == 2
    assert logging.getLogger().handlers == before
    logging.getLogger("tests.log").error("afterwards")
    assert "afterwards" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "is_json", "has_joined"),
    [
        ((), True, False),
        (("--log-format", "text"), False, False),
        (("--verbose",), True, True),
        (("--set", "log.level=info"), True, True),
    ],
)
def test_settings_choose_level_and_format_and_options_precede(
    options: tuple[str, ...], is_json: bool, has_joined: bool
) -> None:
    environment = {"RWT_LOG__LEVEL": "warning", "RWT_LOG__FORMAT": "json"}
    with running("serve", "ws://127.0.0.1:0", *options, environment=environment) as (process, url):
        with connect(url):
            pass
        with pytest.raises(InvalidStatus):
            connect(f"{url}?token=unknown-token")
        process.terminate()
        assert process.stderr is not None
        lines = process.stderr.read().splitlines()
    refused = next(line for line in lines if "auth.tokens" in line)
    assert refused.startswith("{") == is_json
    assert any("client 1 joined from 127.0.0.1 over" in line for line in lines) == has_joined


def test_a_line_names_role_and_credential_of_a_new_client() -> None:
    environment = {
        "RWT_AUTH__TOKENS__TABLET__TOKEN": "0123456789abcdef",
        "RWT_AUTH__TOKENS__TABLET__ROLE": "admin",
        "RWT_AUTH__DEFAULT_ROLE": "viewer",
    }
    with running("serve", "ws://127.0.0.1:0", environment=environment) as (process, url):
        with connect(url), connect(f"{url}?token=0123456789abcdef"):
            pass
        process.terminate()
        assert process.stderr is not None
        log = process.stderr.read()
    assert "client 1 joined from 127.0.0.1 over ws as viewer\n" in log
    assert "client 2 joined from 127.0.0.1 over ws as admin (token tablet)\n" in log
    assert "0123456789abcdef" not in log


def test_a_handshake_that_the_peer_ends_is_logged_with_address_and_reason() -> None:
    pytest.importorskip("cryptography")
    with running("serve", "wss://127.0.0.1:0", "--tls", "auto") as (process, url):
        host, port = url.removeprefix("wss://").split(":")
        with socket.create_connection((host, int(port))):
            pass
        assert process.stderr is not None
        line = next(each for each in process.stderr if "no connection with" in each)
    assert re.search(r"no connection with 127\.0\.0\.1: \S", line)
