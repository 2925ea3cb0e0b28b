"""The runner for client libraries: programs that behave and programs that do not, and the command line."""

from __future__ import annotations

import asyncio
import json
import socket
import sys
from pathlib import Path

import pytest

from rosbridge_conformance import client_player
from rosbridge_conformance import program as programs
from rosbridge_conformance.client_runner import run_client_cases
from rosbridge_conformance.command import main
from rosbridge_conformance.program import Program, ProgramEnded, ProgramError
from rosbridge_conformance.runner import Conditions, Run, select
from rosbridge_conformance.suite.loading import CLIENT_CASES, CaseError, load_cases, read_case
from rosbridge_conformance.suite.target import (
    Target,
    TargetError,
    find_client_target,
    find_target,
    shipped_clients,
)
from rosbridge_conformance.wire.unwrap import decode_text, join_fragments, open_png
from rosbridge_conformance.wire.wires import WireError
from rosbridge_conformance.wire.wrap import cbor, fragments, png, wrap

HERE = Path(__file__).parent


def _command(kind: str) -> list[str]:
    return [sys.executable, str(HERE / "scripted_client.py"), kind]


def _play(
    kind: str,
    *globs: str,
    timeout: float = 3.0,
    url: str = "ws://127.0.0.1:0",
    jobs: int = 1,
    strict: bool = False,
) -> Run:
    target = Target(timeout=timeout)
    cases = select(load_cases(CLIENT_CASES), target, globs)
    assert cases
    return asyncio.run(run_client_cases(cases, target, _command(kind), url, Conditions(jobs, strict)))


def test_a_good_program_is_named_passes_and_tells_what_it_cannot() -> None:
    run = _play("good", "messages/plain", "messages/right-topic", "publish/plain")
    assert run.target.name == "scripted 0.1"
    assert {result.case.id: result.verdict for result in run.results} == {
        "messages/plain": "pass",
        "messages/right-topic": "pass",
        "publish/plain": "unimplemented",
    }
    assert run.results[2].missing == ("no advertise",)
    ways = {line.way for line in run.results[0].transcript}
    assert ways == {">", "<", "!"}


@pytest.mark.parametrize(
    ("kind", "got"),
    [("dies", "the program has ended"), ("hangs", "none within 1 s"), ("refuses", "no subscriptions today")],
)
def test_a_program_that_goes_wrong_fails_the_case_and_is_started_anew(
    kind: str, got: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client_player, "ANSWER_SECONDS", 1.0 if kind == "hangs" else 10.0)
    run = _play(kind, "messages/plain", "connection/quiet", timeout=0.3)
    faults = {result.case.id: result.fault for result in run.results}
    assert all(fault is not None and got in fault.difference.got for fault in faults.values())
    assert len(faults) == 2


@pytest.mark.parametrize(("strict", "verdict"), [(False, "non-strict"), (True, "fail")])
def test_an_exception_that_nobody_caught_is_not_strict(strict: bool, verdict: str) -> None:
    run = _play("throws", "messages/plain", strict=strict)
    assert [result.verdict for result in run.results] == [verdict]
    assert "an uncaught exception: oh" in run.results[0].remarks[0]


@pytest.mark.parametrize("kind", ["dead", "silent"])
def test_a_program_that_never_is_ready(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(programs, "START_SECONDS", 1.0 if kind == "silent" else 20.0)
    monkeypatch.setattr(programs, "END_SECONDS", 0.2)
    with pytest.raises(ProgramError, match="ready") as caught:
        asyncio.run(Program.start(_command(kind)))
    assert ("no such library" in str(caught.value)) == (kind == "dead")


def test_a_program_that_is_not_there() -> None:
    with pytest.raises(ProgramError, match="cannot start"):
        asyncio.run(Program.start(["/no/such/program"]))


def test_telling_a_program_that_has_ended() -> None:
    async def tell() -> None:
        program = await Program.start(_command("good"))
        await program.end()
        await program.tell({"do": "close"})

    with pytest.raises(ProgramEnded):
        asyncio.run(tell())


def test_where_it_listens() -> None:
    with pytest.raises(WireError, match="needs port 0"):
        _play("good", "messages/plain", url="ws://127.0.0.1:9090", jobs=2)
    with pytest.raises(WireError, match="expected ws://"):
        _play("good", "messages/plain", url="tcp://127.0.0.1:0")
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(WireError, match="cannot listen"):
        _play("good", "messages/plain", url=f"ws://127.0.0.1:{taken.getsockname()[1]}")


def test_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "scripted.toml"
    target.write_text('[expected_failures]\n"messages/plain" = "never"\n')
    report = tmp_path / "report.json"
    arguments = ["client", "--run", "messages/plain", "--json", str(report), "--html", str(tmp_path / "html")]
    assert main([*arguments, "--", *_command("good")]) == 0
    assert "scripted 0.1" in capsys.readouterr().out
    value = json.loads(report.read_text())
    assert (value["target"], value["results"][0]["verdict"]) == ("scripted 0.1", "pass")
    assert any("subscribe" in line[3] for line in value["results"][0]["transcript"])
    assert main([*arguments, "--target", str(target), "--", *_command("good")]) == 1
    assert "stale" in capsys.readouterr().out
    assert main([*arguments, "--", "/no/such/program"]) == 2
    assert "cannot start" in capsys.readouterr().err
    assert main([*arguments, "--listen", "ws://nowhere", "--", *_command("good")]) == 3


def test_help_and_lists(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, words in (
        (["--help"], ("client [options] -- COMMAND", "diff", "--target")),
        (["client", "--help"], ("--listen", "--copy-adapters", "roslib-2", "exit codes")),
    ):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == 0
        said = capsys.readouterr().out
        assert all(word in said for word in words), said
    assert main(["client", "--list", "--run", "fragments/*"]) == 0
    assert "fragments/reversed  MUST FRAGMENT-OUT FRG-01" in capsys.readouterr().out
    assert main(["client", "--dry-run", "--run", "messages/plain"]) == 0
    assert "1. told to" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="2"):
        main(["client", "--run", "messages/plain"])
    assert "stands after --" in capsys.readouterr().err


def test_adapters_are_copied(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["client", "--copy-adapters", str(tmp_path / "new")]) == 0
    copied = sorted(path.name for path in (tmp_path / "new").iterdir())
    assert copied == ["roslib.mjs", "roslibpy_adapter.py"]
    assert "roslib.mjs" in capsys.readouterr().out


def test_targets_of_clients_are_their_own() -> None:
    assert shipped_clients() == ("roslib-1", "roslib-2", "roslibpy")
    assert find_client_target("roslib-2").name == "roslib 2.1.0"
    with pytest.raises(TargetError, match="shipped targets are"):
        find_target("roslib-2")


_GOOD = {
    "side": "client",
    "title": "T",
    "rules": ["PUB-01"],
    "level": "MUST",
    "profile": "CORE",
    "steps": [{"tell": {"do": "close"}}, {"hear": {"event": "closed"}}],
}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"side": "server"}, "`tell` is for cases with `side` client"),
        ({"side": "both"}, "side: expected one of server, client"),
        ({"steps": [{"tell": {"do": "fly"}}]}, "steps[0].tell.do: expected one of connect"),
        ({"steps": [{"tell": {"do": "close", "url": "x"}}]}, "unknown key `url`; close takes"),
        ({"steps": [{"tell": "close"}]}, "steps[0].tell: expected an object"),
        ({"steps": [{"send": {}, "via": ["zip"]}]}, "steps[0].via[0]: expected one of png"),
        ({"steps": [{"send": {}, "via": ["fragments"]}]}, "`fragment_size` stands where"),
        (
            {"side": "server", "steps": [{"send": {}, "via": ["png"]}]},
            "`via` is for cases with `side` client",
        ),
    ],
)
def test_client_cases_are_read_strictly(change: dict[str, object], said: str) -> None:
    read_case("a/b", json.loads(json.dumps(_GOOD)))
    with pytest.raises(CaseError) as caught:
        read_case("a/b", json.loads(json.dumps({**_GOOD, **change})))
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("value", "digits"),
    [
        (0, "00"), (23, "17"), (24, "1818"), (256, "190100"), (65536, "1a00010000"),
        (2**32, "1b0000000100000000"),
        (-1, "20"), (-256, "38ff"), (1.5, "fb3ff8000000000000"), (True, "f5"), (False, "f4"), (None, "f6"),
        ("ä", "62c3a4"), ([1, "a"], "82016161"), ({"a": []}, "a1616180"), ({"$bytes": "00ff"}, "4200ff"),
        ({"$tag": 85, "$content": {"$bytes": "0000c03f"}}, "d855440000c03f"),
    ],
)  # fmt: skip
def test_cbor_is_written_in_full(value: object, digits: str) -> None:
    assert cbor(json.loads(json.dumps(value))).hex() == digits


def test_frames_are_wrapped_innermost_first() -> None:
    frame = {"op": "publish", "topic": "/t", "msg": {"data": "ä" * 50}}
    parts = [decode_text(text) for text in wrap(json.loads(json.dumps(frame)), ("png", "fragments"), 40, "f")]
    whole = join_fragments([part for part in parts if isinstance(part, dict)], 40)
    assert isinstance(whole, str)
    picture = decode_text(whole)
    assert isinstance(picture, dict)
    inner = open_png(picture)
    assert isinstance(inner, str) and json.loads(inner) == frame
    assert png("ab").startswith(b"\x89PNG\r\n\x1a\n")
    assert [json.loads(part)["data"] for part in fragments("abcde", 2, "f")] == ["ab", "cd", "e"]
