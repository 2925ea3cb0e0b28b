"""`rwt stop`, `rwt approve` and `rwt audit` against a server with a gate, and `rwt serve --gate observe`."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from rwt.cli import main
from tests.core.cli.conftest import Ended, demo_server, process

TOKENS = {role: f"{role}-token-of-the-test" for role in ("operator", "supervisor", "admin")}
RIGHTS = 'publish = ["*"]\nsubscribe = ["*"]\ncall = ["*"]\ngoals = ["*"]\n'
GATE = (Path(__file__).parent / "transcripts" / "approvals.toml").read_text(encoding="utf-8")
TWIST = ("/cmd_vel", "geometry_msgs/msg/Twist", "{linear: {x: 0.1}}")

ENABLE = ("service", "call", "/enable_motors", "std_srvs/srv/SetBool", "{data: true}")

RunAs = Callable[..., Ended]


def _config(folder: Path) -> Path:
    tokens = "".join(
        f'[auth.tokens.{role}]\ntoken = "{token}"\nrole = "{role}"\n' for role, token in TOKENS.items()
    )
    roles = "".join(f"[roles.{role}]\n{RIGHTS}" for role in ("operator", "supervisor"))
    path = folder / "robot.toml"
    path.write_text(tokens + roles + GATE.replace("{audit}", (folder / "audit.jsonl").as_posix()))
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where settings and audit are."""
    return tmp_path_factory.mktemp("gate")


@pytest.fixture(scope="module")
def gated(folder: Path) -> Iterator[str]:
    """The URL of a demo robot behind a gate."""
    with demo_server("--config", str(_config(folder))) as url:
        yield url


@pytest.fixture
def run_as(gated: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> RunAs:
    """Runs `rwt …` against it with the token of a role."""
    monkeypatch.setenv("RWT_URL", gated)

    def run(role: str, *words: str) -> Ended:
        monkeypatch.setenv("RWT_TOKEN", TOKENS[role])
        capsys.readouterr()
        code = main(words)
        captured = capsys.readouterr()
        return Ended(code, captured.out, captured.err)

    return run


def test_stop_and_release(run_as: RunAs) -> None:
    stopped = run_as("operator", "stop", "--reason", "a test")
    assert stopped.code == 0
    assert stopped.out == "stopped; commands of clients are rejected until it is released\n"
    state = run_as("operator", "topic", "echo", "--once", "/gate/stopped", "--json").json
    assert (state["stopped"], state["reason"]) == (True, "a test")
    refused = run_as("operator", "stop", "--release")
    assert refused.code == 1
    assert "role 'operator' may not release the robot (gate.emergency.release_roles)" in refused.err
    released = run_as("admin", "stop", "--release", "--json")
    assert released.json == {"stopped": False, "message": "released"}


def test_a_rejected_message_fails_the_command(run_as: RunAs) -> None:
    fast = ("/cmd_vel", "geometry_msgs/msg/Twist", "{linear: {x: 1.0}}")
    published = run_as("operator", "topic", "pub", "--once", *fast)
    assert published.code == 1
    assert "message for /cmd_vel: publish: linear.x: expected at most 0.5, got 1" in published.err
    assert run_as("operator", "topic", "pub", "--once", *TWIST).code == 0


def test_a_rejected_advertisement_fails_the_command(run_as: RunAs) -> None:
    published = run_as("operator", "topic", "pub", "--once", "/odom", "std_msgs/msg/String", "{data: x}")
    assert published.code == 1
    assert "it is already established with type nav_msgs/msg/Odometry" in published.err


def test_approve(run_as: RunAs, gated: str) -> None:
    assert run_as("supervisor", "approve").out == "no pending requests\n"
    # It waits for longer than the one who asks: its caller has gone when the answer is there.
    assert run_as("operator", *ENABLE, "--timeout", "1").code == 4
    assert run_as("supervisor", "approve", "--json").json == []
    unknown = run_as("supervisor", "approve", "1")
    assert (unknown.code, "nothing waits for an answer under id '1'" in unknown.err) == (1, True)
    for words in (("--no",), ("1", "--no", "--for", "3")):
        assert run_as("supervisor", "approve", *words).code == 2


def test_approve_while_it_waits(run_as: RunAs, gated: str) -> None:
    caller = process(*ENABLE, "--token", TOKENS["operator"], url=gated)
    try:
        listed: list[dict[str, object]] = []
        for _ in range(200):
            listed = run_as("supervisor", "approve", "--json").json
            if listed:
                break
        (waiting,) = listed
        assert (waiting["act"], waiting["name"], waiting["role"]) == ("call", "/enable_motors", "operator")
        shown = run_as("supervisor", "approve").out
        who = f"{waiting['client']} (role operator, gate.rules.asked)"
        assert f"{waiting['id']}  call /enable_motors  by {who}" in shown
        assert run_as("operator", "approve", str(waiting["id"])).code == 1
        said = run_as("supervisor", "approve", str(waiting["id"]), "--for", "30")
        assert (said.code, said.out.startswith("approved: call /enable_motors of ")) == (0, True)
        out, err = caller.communicate(timeout=60)
        assert caller.returncode == 0, err
        assert "success=True" in out
        assert re.search(
            r"^waiting for approval by supervisor \(\d+ s left\)\napproved$", err, re.MULTILINE
        ), err
        assert "the server says" not in err
    finally:
        caller.kill()
        caller.communicate()


ASKED = {
    "goal": ("action", "send_goal", "/fibonacci", "{order: 2}"),
    "message": ("topic", "pub", "--once", "-w", "0", "/asked", "std_msgs/msg/String", "{data: x}"),
}


@pytest.mark.parametrize("kind", ASKED)
@pytest.mark.parametrize("answer", ["approved", "denied"])
def test_a_command_says_that_it_waits_for_approval(run_as: RunAs, gated: str, kind: str, answer: str) -> None:
    caller = process(*ASKED[kind], "--token", TOKENS["operator"], url=gated)
    try:
        words = () if answer == "approved" else ("--no",)
        code = None
        for _ in range(200):  # The list is at most 0.1 s old and may still show an answered request.
            for listed in run_as("supervisor", "approve", "--json").json:
                code = run_as("supervisor", "approve", str(listed["id"]), *words).code
            if code == 0:
                break
        assert code == 0
        out, err = caller.communicate(timeout=60)
        assert "waiting for approval by supervisor (" in err
        assert (caller.returncode == 0) == (answer == "approved"), err
        assert ("a person said no" in err) == (answer == "denied")
        if kind == "message":
            assert out.count("publishing #1") == (2 if answer == "approved" else 1)
    finally:
        caller.kill()
        caller.communicate()


def test_audit(run_as: RunAs, folder: Path) -> None:
    run_as("operator", "topic", "pub", "--once", *TWIST)
    run_as("operator", "stop", "--reason", "for the audit")
    run_as("operator", "topic", "pub", "--once", *TWIST)
    run_as("admin", "stop", "--release")
    file = str(folder / "audit.jsonl")
    lines: list[dict[str, object]] = []
    for _ in range(200):  # A thread writes them.
        lines = run_as("operator", "audit", "show", file, "--json").records
        if lines and lines[-1]["act"] == "release":
            break
    stops = run_as("operator", "audit", "show", file, "--decision", "stop", "--since", "1h").out
    assert "stop by rosbridge:" in stops and "for the audit" in stops
    show = partial(run_as, "operator", "audit", "show", file)
    refused = show("--decision", "refused", "--name", "/cmd_*", "--json").records
    assert refused[-1]["rule"] == "gate.rules.drive.emergency"
    assert show("--role", "admin", "--act", "release").out
    assert show("--rule", "gate.rules.none*").out == show("--since", "2999-01-01T00:00Z").out == ""
    missing = run_as("operator", "audit", "show", str(folder / "missing"))
    assert (missing.code, "cannot be read" in missing.err) == (2, True)
    assert json.loads((folder / "audit.jsonl").read_text().splitlines()[0])["time"].endswith("Z")


def test_serve_with_a_gate_that_observes(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with demo_server("--config", str(_config(folder)), "--gate", "observe") as url:
        monkeypatch.setenv("RWT_URL", url)
        monkeypatch.setenv("RWT_TOKEN", TOKENS["operator"])
        capsys.readouterr()
        assert main(("stop",)) == 1
        assert "the gate only observes and refuses nothing (gate.mode)" in capsys.readouterr().err
        assert main(ENABLE) == 0
