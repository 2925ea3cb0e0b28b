"""Playback of a recording: times, order, and control by a client."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import anyio
import pytest
from anyio.lowlevel import checkpoint

from rwt.extensions.recording import RecordingWriter, TopicSelection, channel_form, open_recording
from rwt.extensions.recording.channels import KEPT
from rwt.extensions.recording.playback import PlaybackClock, Player, PlayOptions
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_graph.api import Sample
from rwt_interfaces import JAZZY, Registry
from rwt_participant.messages import Message

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """`/count` at 0, 1, 2, 3 and 4 s; a latched `/mode` at 0.5 and 2.5 s."""
    file = tmp_path / "run.mcap"
    registry = Registry(JAZZY)
    number, text = registry.message("std_msgs/Int32"), registry.message("std_msgs/String")
    with RecordingWriter(file, JAZZY) as writer:
        count = writer.add_channel(channel_form("/count", number, "ros"))
        mode = writer.add_channel(channel_form("/mode", text, "ros", (KEPT,)))
        for index in range(5):
            data = number.to_cdr(number.struct(data=index))
            writer.write(count, START + index * SECOND, START + index * SECOND, data)
        for at, word in ((SECOND // 2, "slow"), (5 * SECOND // 2, "fast")):
            writer.write(mode, START + at, START + at, text.to_cdr(text.struct(data=word)))
    return file


@dataclass
class Heard:
    """A player under a virtual clock, and what its listeners hear: topic, seconds of the clock, data."""

    player: Player
    clock: SimulatedClock
    graph: MemoryGraph
    node: Node
    messages: list[tuple[str, float, object]] = field(default_factory=list)

    def counts(self) -> list[object]:
        return [data for topic, _, data in self.messages if topic == "/count"]


@contextmanager
def playing(path: Path, options: PlayOptions | None = None) -> Iterator[Heard]:
    with open_recording([path]) as recording:
        clock = SimulatedClock(recording.start_ns)
        graph = MemoryGraph(clock=clock)
        with Player(graph, recording, options) as player, Node(graph, "listener") as node:
            heard = Heard(player, clock, graph, node)

            def listen(topic: str) -> None:
                def hear(sample: Sample) -> None:
                    message: Any = sample.payload.value()
                    heard.messages.append((topic, (sample.stamp_ns - START) / SECOND, message.data))

                node.subscribe_samples(topic, on_sample=hear)

            for name in ("/count", "/mode", "/renamed"):
                listen(name)
            yield heard


def test_messages_come_at_their_times_and_no_earlier(path: Path) -> None:
    with playing(path) as heard:
        heard.clock.advance(0.999_999_999)
        assert heard.messages == [("/count", 0.0, 0), ("/mode", 0.5, "slow")]
        heard.clock.advance(0.000_000_001)
        assert heard.messages[-1] == ("/count", 1.0, 1)
        assert heard.player.position_ns == START + SECOND
        heard.clock.advance(60.0)
        assert heard.counts() == [0, 1, 2, 3, 4]
        assert (heard.player.played, heard.player.paused, heard.player.finished.is_set()) == (7, True, True)


def test_speed(path: Path) -> None:
    with playing(path, PlayOptions(rate=2.0)) as heard:
        heard.clock.advance(1.0)
        assert heard.counts() == [0, 1, 2]
        heard.player.set_rate(0.5)
        heard.clock.advance(1.9)
        assert heard.counts() == [0, 1, 2]
        heard.clock.advance(0.2)
        assert heard.counts() == [0, 1, 2, 3]


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf"), 1e9])
def test_an_impossible_speed_is_refused(path: Path, rate: float) -> None:
    with playing(path) as heard:
        with pytest.raises(ValueError, match=r"from 0\.001 to 1000"):
            heard.player.set_rate(rate)
        heard.clock.advance(10.0)
        assert heard.counts() == [0, 1, 2, 3, 4]


def test_pause_step_and_resume(path: Path) -> None:
    with playing(path, PlayOptions(paused=True)) as heard:
        heard.clock.advance(100.0)
        assert heard.messages == []
        assert heard.player.play_next()
        assert heard.player.play_next()
        assert [(topic, data) for topic, _, data in heard.messages] == [("/count", 0), ("/mode", "slow")]
        assert heard.player.position_ns == START + SECOND // 2
        heard.player.resume()
        assert not heard.player.play_next()
        heard.clock.advance(0.5)
        assert heard.counts() == [0, 1]
        heard.player.toggle_paused()
        heard.clock.advance(10.0)
        assert heard.player.burst(2) == 2
        assert heard.counts() == [0, 1, 2]
        assert heard.player.burst(0) == 2
        assert heard.player.finished.is_set()
        assert heard.player.burst(0) == 0


def test_a_part_of_a_recording_begins_with_what_was_kept_by_then(path: Path) -> None:
    with playing(path, PlayOptions(start=1.5, end=3.0)) as heard:
        # The listener came late, and still hears it.
        assert heard.messages == [("/mode", 0.0, "slow")]
        heard.clock.advance(10.0)
        assert heard.counts() == [2, 3]


@pytest.mark.parametrize(("start", "end"), [(-1.0, None), (5.0, None), (2.0, 1.0)])
def test_a_part_that_is_not_there_is_refused(path: Path, start: float, end: float | None) -> None:
    with pytest.raises(ValueError, match="cannot"), playing(path, PlayOptions(start=start, end=end)):
        pass


def test_loop(path: Path) -> None:
    with playing(path, PlayOptions(loop=True)) as heard:
        heard.clock.advance(9.0)
        assert heard.counts() == [0, 1, 2, 3, 4, 0, 1, 2, 3, 4, 0, 1]
        assert not heard.player.finished.is_set()


def test_a_burst_ends_where_the_recording_does_also_in_a_loop(path: Path) -> None:
    with playing(path, PlayOptions(loop=True, paused=True)) as heard:
        assert heard.player.burst(0) == 7
        assert heard.player.burst(100) == 7
        assert heard.counts() == [0, 1, 2, 3, 4] * 2


@pytest.mark.anyio
async def test_a_long_burst_gives_others_their_turn(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rwt.extensions.recording.playback.player.BATCH", 3)
    with playing(path, PlayOptions(paused=True)) as heard:
        async with heard.graph:
            answers: list[Any] = []

            async def burst() -> None:
                answers.append(await heard.node.call("/rosbag2_player/burst", {"num_messages": 0}))

            async with anyio.create_task_group() as tasks:
                tasks.start_soon(burst)
                with anyio.fail_after(10):
                    while not heard.messages:
                        await checkpoint()
                assert heard.counts() == [0, 1]  # and the mode
                assert not answers
                heard.clock.advance(0.0)
            assert [answer.actually_burst for answer in answers] == [7]
            assert heard.counts() == [0, 1, 2, 3, 4]


def test_a_closed_player_has_nothing_to_play(path: Path) -> None:
    with playing(path, PlayOptions(paused=True)) as heard:
        heard.player.close()
        assert heard.player.burst(0) == 0


def test_a_moment_does_not_loop(path: Path) -> None:
    with playing(path, PlayOptions(loop=True, start=1.0, end=1.0)) as heard:
        heard.clock.advance(1.0)
        assert heard.counts() == [1]
        assert heard.player.finished.is_set()


def test_a_subscriber_may_control_the_player(path: Path) -> None:
    with playing(path, PlayOptions(paused=True)) as heard:
        back = [START]

        def go_back_once(message: Message) -> None:
            if message.data == 4 and back:
                heard.player.seek(back.pop())

        heard.node.subscribe("/count", go_back_once)
        assert heard.player.burst(0) == 14
        assert heard.counts() == [0, 1, 2, 3, 4, 0, 1, 2, 3, 4]


def test_selection_and_remap(path: Path) -> None:
    options = PlayOptions(selection=TopicSelection(("/co*",)), remap={"count": "renamed"})
    with playing(path, options) as heard:
        heard.clock.advance(10.0)
        assert [(topic, data) for topic, _, data in heard.messages] == [("/renamed", n) for n in range(5)]


def test_seek(path: Path) -> None:
    with playing(path) as heard:
        heard.clock.advance(1.0)
        assert heard.player.seek(START + 3 * SECOND)
        assert heard.messages[-1][2] == "fast"
        heard.clock.advance(0.0)
        assert heard.counts() == [0, 1, 3]
        assert not heard.player.seek(START - 1)
        assert not heard.player.seek(START + 5 * SECOND)
        heard.clock.advance(1.0)
        assert heard.counts() == [0, 1, 3, 4]
        assert heard.player.seek(START)
        heard.player.resume()
        heard.clock.advance(10.0)
        assert heard.counts() == [0, 1, 3, 4, 0, 1, 2, 3, 4]


@pytest.mark.anyio
async def test_rosbag2s_services_control_the_player(path: Path) -> None:
    with playing(path, PlayOptions(paused=True)) as heard:
        async with heard.graph:

            async def call(name: str, request: dict[str, object] | None = None) -> Any:
                with anyio.fail_after(10):
                    return await heard.node.call(f"/rosbag2_player/{name}", request)

            assert (await call("is_paused")).paused
            assert (await call("play_next")).success
            assert (await call("burst", {"num_messages": 2})).actually_burst == 2
            assert heard.counts() == [0, 1]
            assert (await call("set_rate", {"rate": 4.0})).success
            assert not (await call("set_rate", {"rate": 0.0})).success
            assert (await call("get_rate")).rate == 4.0
            await call("resume")
            heard.clock.advance(0.25)
            assert heard.counts() == [0, 1, 2]
            await call("pause")
            await call("toggle_paused")
            await call("toggle_paused")
            assert heard.player.paused
            there, elsewhere = ({"sec": 1_700_000_000 + at, "nanosec": 0} for at in (3, 9))
            assert (await call("seek", {"time": there})).success
            assert not (await call("seek", {"time": elsewhere})).success
            assert heard.player.position_ns == START + 3 * SECOND


@pytest.mark.anyio
async def test_a_playback_clock_gives_every_message_its_own_stamp_and_plays_in_real_time(path: Path) -> None:
    with open_recording([path]) as recording:
        clock = PlaybackClock(recording.start_ns)
        async with MemoryGraph(clock=clock) as graph:
            stamps: list[int] = []
            with Node(graph, "listener") as node, Player(graph, recording, PlayOptions(rate=100.0)) as player:
                node.subscribe_samples("/count", on_sample=lambda sample: stamps.append(sample.stamp_ns))
                with anyio.fail_after(20):
                    await player.finished.wait()
                assert stamps == [START + index * SECOND for index in range(5)]
                assert clock.time_ns() == START + 4 * SECOND


@pytest.mark.anyio
async def test_the_clock_topic_tells_the_recordings_time(path: Path) -> None:
    with open_recording([path]) as recording:
        async with MemoryGraph(clock=PlaybackClock(recording.start_ns)) as graph:
            with (
                Node(graph, "listener") as node,
                Player(graph, recording, PlayOptions(rate=20.0, clock_hz=100.0)) as player,
            ):
                times: list[int] = []
                node.subscribe("/clock", lambda message: times.append(message.clock.sec))
                with anyio.fail_after(20):
                    await player.finished.wait()
                assert times == sorted(times)
                assert 1_700_000_000 <= times[0] <= times[-1] <= 1_700_000_004


def test_what_cannot_be_played_is_named_and_left_out(tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    number = Registry(JAZZY).message("std_msgs/Int32")
    with RecordingWriter(file, JAZZY) as writer:
        good = writer.add_channel(channel_form("/good", number, "ros"))
        writer.write(good, START, START, number.to_cdr(number.struct(data=1)))
        writer.write(good, START, START, b"\0\1\0\0short")
    with open_recording([file]) as recording:
        clock = SimulatedClock(recording.start_ns)
        with Player(MemoryGraph(clock=clock), recording) as player:
            clock.advance(1.0)
            assert (player.played, player.publications.unreadable) == (1, 1)


@pytest.mark.parametrize("bad", ["/a b", "", "/" + "x" * 600, "/taken"])
def test_a_topic_that_cannot_be_played_keeps_no_other_from_it(tmp_path: Path, bad: str) -> None:
    path = tmp_path / "run.mcap"
    form = channel_form("/good", Registry(JAZZY).message("std_msgs/String"), "ros")
    with RecordingWriter(path, JAZZY) as writer:
        for channel in (replace(form, topic=bad), form):
            recorded = writer.add_channel(channel)
            for number in (1, 2):
                writer.write(recorded, number, number, b"\0\1\0\0\2\0\0\0a\0")
    clock = SimulatedClock(START)
    graph = MemoryGraph(clock=clock)
    graph.participant("/other").advertise("/taken", graph.registry.message("std_msgs/Int32"))
    heard: list[str] = []
    Node(graph, "ear").subscribe("/good", lambda message: heard.append(message.data))
    with open_recording([path]) as recording, Player(graph, recording) as player:
        clock.advance(1)
        assert player.finished.is_set()
        assert heard == ["a", "a"]
        (loss,) = player.losses
        assert loss.startswith(f"{bad}: ")


def test_what_only_the_server_publishes_is_not_played(path: Path) -> None:
    graph = MemoryGraph(Registry(JAZZY), SimulatedClock(START))
    graph.reserve(["/mode"])
    with open_recording([path]) as recording:
        player = Player(graph, recording)
        assert player.publications.topics == {"/count"}
        assert player.publications.skipped == {"/mode": "only this server publishes on /mode"}
        player.close()
