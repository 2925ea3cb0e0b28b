"""`rwt bag` as its users meet it: processes, files and signals."""

from __future__ import annotations

import json
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from unittest.mock import Mock, call

import httpx
import pytest

from rwt.cli import main
from rwt.extensions.recording import RecordingWriter, open_recording
from rwt.extensions.recording.commands.play import parse_remap, press
from rwt.extensions.recording.commands.record import parse_split
from rwt.extensions.recording.mcap_files import McapRecording
from rwt.extensions.recording.writer import START_BYTES
from rwt_client.blocking import connect
from rwt_interfaces import JAZZY
from tests import processes
from tests.extensions.recording.robots import record_chunks, rows
from tests.waiting import wait_until

URL = "ws://127.0.0.1:0"
running = partial(processes.running, stderr=subprocess.STDOUT)

OWN = (
    "--exclude",
    *("/rosout", "/parameter_events", "/client_count", "/connected_clients", "/tf2_web_republisher/*"),
    # Raw pictures at four times their rate are more than a busy machine may pass on; the JPEGs stay.
    *("/camera/image_raw", "/camera/depth/image_raw", "/camera/depth/points", "/depthcloud_encoded"),
)
# Every distribution with every encoding is compared without a network in tests/extensions/recording.
FORMS = [("jazzy", "ros"), ("noetic", "json")]


@pytest.fixture(autouse=True)
def logging_as_before() -> Iterator[None]:
    """`rwt bag record` quiets a logger of this process."""
    own = logging.getLogger("rwt.extensions.recording.writer")
    level = own.level
    yield
    own.setLevel(level)


def _unnumbered(path: Path) -> list[tuple[object, ...]]:
    return [(*row[:4], row[5]) for row in rows(path)]


@pytest.mark.parametrize(("distro", "encoding"), FORMS)
def test_record_play_record_is_the_same_message_for_message_and_stamp_for_stamp(
    tmp_path: Path, distro: str, encoding: str
) -> None:
    first, second = tmp_path / "first.mcap", tmp_path / "second.mcap"
    with running("serve", URL, "--demo", "--distro", distro) as (_, url):
        arguments = ("bag", "record", "--url", url, "-o", str(first), "--encoding", encoding, *OWN)
        with running(*arguments, ready="recording ") as (recorder, _):
            wait_until(lambda: first.stat().st_size > 20_000)
    player_arguments = ("bag", "play", str(first), URL, "--start-paused", "--rate", "4")
    with running(*player_arguments) as (player, url):
        again = ("bag", "record", "--url", url, "-o", str(second), "--encoding", encoding, "--no-reconnect")
        with running(*again, *OWN, ready="recording ") as (recorder, _):
            with connect(url) as robot:
                assert robot.call("/rosbag2_player/is_paused").paused
                robot.call("/rosbag2_player/resume")
            assert recorder.wait(timeout=processes.LONGEST) == 0
        assert player.wait(timeout=processes.LONGEST) == 0
    assert {"/odom", "/scan", "/map", "/tf_static"} <= {row[0] for row in rows(first)}
    # Messages of one time may come in another order: what was kept comes by topic.
    assert sorted(_unnumbered(second)) == sorted(_unnumbered(first))


def test_a_recording_survives_kill_9(tmp_path: Path, demo: str, capsys: pytest.CaptureFixture[str]) -> None:
    path, whole = tmp_path / "run.mcap", tmp_path / "whole.mcap"
    words = ("bag", "record", "--url", demo, "-o", str(path), *OWN)
    with running(*words, ready="recording ") as (recorder, _):
        began = path.stat().st_size
        wait_until(lambda: path.stat().st_size > began + 50_000)
        recorder.send_signal(signal.SIGKILL)
        recorder.wait(timeout=60)
    with McapRecording(path) as recording:
        assert not recording.complete
        assert {"/odom", "/map"} <= {topic.name for topic in recording.topics}
        count = len(list(recording.messages()))
    assert count > 10  # one picture alone is more than 5000 bytes
    assert main(["bag", "recover", str(path), "-o", str(whole)]) == 0
    assert f"{count} messages" in capsys.readouterr().out
    assert len(rows(whole)) == count
    assert main(["bag", "info", "--json", str(path)]) == 0
    assert json.loads(capsys.readouterr().out)["complete"] is False


def test_of_a_damaged_recording_the_rest_is_played_and_recovered_and_the_end_is_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, to = tmp_path / "run.mcap", tmp_path / "to.mcap"
    record_chunks(path)
    path.write_bytes(path.read_bytes().replace(b"DDDDDDDD", b"????????", 1))
    played = processes.ended("bag", "play", str(path), URL)
    assert played.returncode == 1
    assert "not played: 1 damaged places of the recording" in played.stderr
    assert "Traceback" not in played.stderr
    assert main(["bag", "recover", str(path), "-o", str(to)]) == 1
    printed = capsys.readouterr()
    assert "6 messages of 1 topics" in printed.out
    assert "1 damaged chunks" in printed.err
    assert len(rows(to)) == 6


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_recording_cleanly(path: Path, demo: str, how: signal.Signals) -> None:
    words = ("bag", "record", "/odom", "tf*", "--url", demo, "-o", str(path))
    with running(*words, ready="recording ", real=how is signal.SIGINT) as (recorder, _):
        time.sleep(0.3)
        recorder.send_signal(how)
        output, _ = recorder.communicate(timeout=60)
        assert recorder.returncode == 0
    assert f"messages in {path}" in output
    with open_recording([path]) as recording:
        assert recording.complete
        assert [topic.name for topic in recording.topics] == ["/odom", "/tf", "/tf_static"]


def test_a_second_sigterm_does_not_cut_a_recording(path: Path) -> None:
    """GNU's `timeout` sends it to its child, and then to the whole group of processes."""
    with running("serve", URL, "--demo", "--record", str(path), real=True) as (server, _):
        time.sleep(0.3)
        for _ in range(2):
            server.send_signal(signal.SIGTERM)
            time.sleep(0.001)  # Signals at the same time would be one.
        server.communicate(timeout=60)
    with open_recording([path]) as recording:
        assert recording.complete


def test_serve_records_topics_and_calls(path: Path) -> None:
    arguments = ("serve", URL, "--demo", "--introspection", "--record", str(path))
    with running(*arguments) as (server, url):
        with connect(url) as robot:
            assert robot.call("/add_two_ints", {"a": 20, "b": 22}).sum == 42
        server.send_signal(signal.SIGINT)
        server.communicate(timeout=60)
        assert server.returncode == 0
    with running("bag", "play", str(path), URL, "--start-paused") as (_, url), connect(url) as robot:
        assert robot.call("/add_two_ints", {"a": 20, "b": 22}).sum == 42


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits the files of another process")
def test_a_server_whose_recording_fails_reports_it_and_ends_without_a_traceback(path: Path) -> None:
    import resource

    with running("serve", URL, "--demo", "--record", str(path), real=True) as (server, url):
        page = partial(httpx.get, timeout=60)
        pages = url.replace("ws:", "http:", 1)
        wait_until(lambda: path.stat().st_size > 1000)
        assert "problems" not in page(f"{pages}/healthz").json()
        assert "rwt_record_failed 0" in page(f"{pages}/metrics").text
        # A limit on the size of its files stands for a full disk: the kernel refuses to write.
        resource.prlimit(server.pid, resource.RLIMIT_FSIZE, (path.stat().st_size, resource.RLIM_INFINITY))
        wait_until(lambda: "problems" in page(f"{pages}/healthz").json())
        assert page(f"{pages}/healthz").json()["problems"] == ["recording of all topics: File too large"]
        assert "rwt_record_failed 1" in page(f"{pages}/metrics").text
        server.send_signal(signal.SIGINT)
        output, _ = server.communicate(timeout=60)
    assert server.returncode == 1
    assert "Traceback" not in output
    assert output.count("ERROR") == 1
    with open_recording([path]) as recording:
        assert not recording.complete
        assert recording.message_count > 0


def test_topics_that_come_later_are_recorded_and_service_events_if_asked_for(path: Path) -> None:
    serve = ("serve", URL, "--demo", "--introspection")
    record = ("bag", "record", "/late", "/add_two_ints/*", "--services", "-o", str(path))
    with (
        running(*serve) as (_, url),
        running(*record, "--url", url, ready="recording ") as (recorder, _),
        connect(url) as robot,
    ):
        robot.call("/add_two_ints", {"a": 1, "b": 1})
        late = robot.advertise("/late", "std_msgs/String")
        wait_until(lambda: bool(robot.api.subscribers("/late")))
        late.publish({"data": "here"})
        began = path.stat().st_size
        wait_until(lambda: path.stat().st_size > began)
        recorder.send_signal(signal.SIGINT)
        recorder.communicate(timeout=60)
    topics = [row[0] for row in rows(path)]
    assert topics.count("/late") == 1
    assert topics.count("/add_two_ints/_service_event") == 2


def test_what_ends_a_recording_is_one_line(tmp_path: Path, demo: str) -> None:
    path, there = tmp_path / "run.mcap", tmp_path / "there.mcap"
    there.touch()
    # The shell's limit on a file's size stands for a full disk: the kernel refuses to write.
    limited = f"ulimit -f {START_BYTES // 512 + 1}; exec {sys.executable} -m rwt.cli bag record"
    limited += f" --url {demo} --compression none -o {path}"
    full = subprocess.run(["sh", "-c", limited], capture_output=True, text=True, timeout=100)
    refused = processes.ended("bag", "record", "--url", demo, "-o", str(there))
    assert full.returncode == 1
    assert (
        "cannot be written any more: File too large; what was written until then can be played" in full.stderr
    )
    assert len([line for line in full.stderr.splitlines() if "cannot be written" in line]) == 1
    with open_recording([path]) as recording:
        assert not recording.complete
    assert (refused.returncode, refused.stderr.count("\n")) == (1, 1)
    assert "there.mcap is there already" in refused.stderr


def test_a_robot_without_rosapi_cannot_be_recorded(tmp_path: Path) -> None:
    with running("serve", URL, "--set", "nodes=[]") as (_, url):
        done = processes.ended("bag", "record", "--url", url, "-o", str(tmp_path / "run.mcap"))
    assert done.returncode == 1
    assert "rosapi does not answer at" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_recording_of_topics_that_are_not_there_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with running("serve", URL) as (_, url):
        seconds = ("--max-seconds", "0.1")
        assert main(("bag", "record", "/odm", "--url", url, "-o", str(tmp_path / "a.mcap"), *seconds)) == 0
    assert "no messages on the given topics" in capsys.readouterr().err


def test_wrong_calls_are_said_in_a_line(
    path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path.write_bytes(b"")
    good = tmp_path / "good.mcap"
    RecordingWriter(good, JAZZY).close()
    for line, code, text in (
        ("bag play", 2, "expected a recording to play"),
        (f"bag play --topics /odom {good}", 2, "put it before options that take several words"),
        (f"bag play {good} --topics /odom {URL}", 2, f"'{URL}' is not a topic pattern"),
        ("bag record /odom ws://robot:9090", 2, "'ws://robot:9090' is not a topic pattern"),
        ("bag record run.mcap", 2, "to record to it: -o run.mcap"),
        ("bag record --max-seconds -1", 2, "expected seconds from 1e-06 to 1e+09, got '-1'"),
        (f"bag play {URL}", 2, "expected a recording to play"),
        (f"bag play {path}", 1, "is not a recording"),
        (f"bag play {tmp_path}", 1, "is no recording: a folder of rosbag2 has a file metadata.yaml"),
        (f"bag play {tmp_path}/gone.mcap", 1, "there is no such file"),
        (f"bag record --url ws://127.0.0.1:1 -o {tmp_path}/new.mcap", 3, "rwt: "),
        (f"bag play {good} {URL} --start-offset 9", 2, "cannot be played from 9.0 s"),
        (f"bag play {good} {URL} --rate 0", 2, "expected a rate from 0.001 to 1000"),
        (f"bag play {good} tcp://256.0.0.1:1", 1, "rwt: "),
        (f"bag info {path}", 1, "is not a recording"),
        (f"serve {URL} --record {path}", 2, "run.mcap is there already"),
        (f"serve {URL} --record-split 1m", 2, "require --record"),
        ("serve --record a.mcap --record-keep 3", 2, "requires --record-split"),
        (f"serve {URL} --introspection --distro noetic", 2, "is of ROS 2"),
    ):
        try:
            assert main(line.split()) == code
        except SystemExit as ended:
            assert ended.code == code
        errors = capsys.readouterr().err
        assert text in errors
    assert not (tmp_path / "new.mcap").exists()


def test_split_and_remap_are_read() -> None:
    assert (parse_split("500MB").size, parse_split("1.5 gb").size) == (500_000_000, 1_500_000_000)
    assert (parse_split("30s").seconds, parse_split("10m").seconds) == (30.0, 600.0)
    assert parse_remap("/a:=/b") == ("/a", "/b")
    for text in ("", "10", "0s", "GB", "-1s", "1 week"):
        with pytest.raises(Exception, match="neither a size nor a duration"):
            parse_split(text)
    for text in ("/a", "/a:=", ":=/b"):
        with pytest.raises(Exception, match="expected OLD:=NEW"):
            parse_remap(text)


def test_keys_control_a_player() -> None:
    player = Mock(rate=1.0)
    for key in ("space", "right", "up", "down"):
        press(player, key)
    faster, slower = pytest.approx(1.1), pytest.approx(1 / 1.1)
    assert player.mock_calls == [
        call.toggle_paused(), call.play_next(), call.set_rate(faster), call.set_rate(slower)
    ]  # fmt: skip


@pytest.mark.skipif(sys.platform == "win32", reason="needs a terminal of Unix")
def test_space_in_a_terminal_goes_on_until_the_end(path: Path) -> None:
    import pty

    RecordingWriter(path, JAZZY).close()
    ours, theirs = pty.openpty()
    words = ("bag", "play", str(path), URL, "--start-paused")
    process = processes.start(*words, terminal=theirs, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    try:
        assert process.stdout is not None
        assert any(line.startswith("listening on ") for line in process.stdout)
        assert process.stdout.readline().startswith("playing 0 messages")
        # Until it reads keys it takes lines, and keeps what was typed.
        os.write(ours, b" ")
        process.wait(timeout=60)
        assert process.returncode == 0
    finally:
        process.kill()
        process.communicate()
        os.close(ours)
        os.close(theirs)
