"""A recording that is played: shown to clients as what it is, and controlled by those who may."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from rwt import MemoryGraph, SimulatedClock
from rwt.extensions.recording import open_recording
from rwt.extensions.recording.playback import PlaybackClock, Player, PlayOptions
from rwt_interfaces.registry import Registry
from tests.conftest import START_NS
from tests.extensions.foxglove.conftest import gateway_of, guest
from tests.extensions.foxglove.viewer import State, Viewer
from tests.extensions.recording.robots import record_seconds

SECOND = 10**9
PLAYING, PAUSED, ENDED = 0, 1, 3


class SteppedPlayback(PlaybackClock):
    """A clock of a recording on which time passes when the test says so."""

    def __init__(self, start_ns: int) -> None:
        super().__init__(start_ns)
        self._steps = SimulatedClock()
        self.monotonic = self._steps.monotonic  # in place of the real one
        self.call_later = self._steps.call_later  # type: ignore[method-assign]  # timers wait for the steps of the test
        self.advance = self._steps.advance


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "run.mcap"
    record_seconds(path, START_NS)
    return path


class Stand:
    """A player and the gateway in front of its graph."""

    def __init__(self, file: Path, **settings: object) -> None:
        self.recording = open_recording([file])
        opened = self.recording.__enter__()
        self.clock = SteppedPlayback(opened.start_ns)
        self.graph = MemoryGraph(Registry(opened.distro), self.clock)
        self.player = Player(self.graph, opened, PlayOptions(paused=True))
        self.gateway = gateway_of(self.graph, **settings)

    def close(self) -> None:
        self.gateway.close()
        self.player.close()
        self.recording.__exit__(None, None, None)


@pytest.fixture
def stand(file: Path) -> Iterator[Stand]:
    stand = Stand(file)
    yield stand
    stand.close()


def states(viewer: Viewer) -> list[State]:
    return [each for each in viewer.heard() if isinstance(each, State)]


def test_the_first_text_says_how_long_the_recording_is(stand: Stand) -> None:
    info, *_, state = Viewer(stand.gateway).welcome
    assert {"time", "playbackControl"} < set(info["capabilities"])
    assert info["dataStartTime"] == {"sec": START_NS // SECOND, "nsec": 0}
    assert info["dataEndTime"] == {"sec": START_NS // SECOND + 6, "nsec": 0}
    assert state == State(PAUSED, START_NS, 1.0, 0, "")


def test_a_request_plays_seeks_and_changes_the_speed(stand: Stand) -> None:
    viewer = Viewer(stand.gateway)
    viewer.subscribe("/n")
    viewer.heard()
    viewer.control(play=True, speed=2.0, seek_ns=START_NS + 2 * SECOND, request="first")
    assert states(viewer) == [State(PLAYING, START_NS + 2 * SECOND, 2.0, 1, "first")]
    assert (stand.player.paused, stand.player.rate) == (False, 2.0)
    stand.clock.advance(0.6)
    assert [data.time_ns for data in viewer.heard_data()] == [START_NS + 2 * SECOND, START_NS + 3 * SECOND]
    viewer.control(play=False, speed=2.0, request="second")
    (state,) = [state for state in states(viewer) if state.request]
    assert (state.status, state.did_seek, state.request) == (PAUSED, 0, "second")
    assert state.time_ns == START_NS + 2 * SECOND + 1_200_000_000


def test_everybody_hears_what_others_do_and_the_end(stand: Stand) -> None:
    one, other = Viewer(stand.gateway), Viewer(stand.gateway)
    one.heard(), other.heard()
    one.control(play=True)
    stand.clock.advance(0.1)
    assert [state.status for state in states(other)][-1] == PLAYING
    stand.player.seek(START_NS + 4 * SECOND)
    stand.clock.advance(0.1)
    assert [(state.status, state.did_seek) for state in states(other)] == [(PLAYING, 1)]
    stand.clock.advance(2.5)
    assert states(other)[-1].status == ENDED
    assert states(one)[-1].time_ns == START_NS + 6 * SECOND


def test_what_is_not_possible_is_told_and_the_state_comes_nevertheless(stand: Stand) -> None:
    viewer = Viewer(stand.gateway)
    viewer.control(play=False, speed=0.0, seek_ns=0, request="x")
    heard = viewer.heard()
    assert "set_rate" in str([each for each in heard if isinstance(each, dict)])
    (state,) = [each for each in heard if isinstance(each, State)]
    # A time before the beginning is the beginning.
    assert state == State(PAUSED, START_NS, 1.0, 1, "x")
    for speed in (float("nan"), float("inf"), -1.0, 1e30):
        viewer.control(play=False, speed=speed)
        assert "set_rate" in str(viewer.heard())
    assert stand.player.rate == 1.0


def test_who_may_not_call_the_player_only_watches(file: Path) -> None:
    stand = Stand(file, **guest(subscribe=["*"]))
    viewer = Viewer(stand.gateway)
    viewer.control(play=True)
    heard = viewer.heard()
    assert "roles.guest.call" in str(heard)
    assert stand.player.paused
    stand.close()


def test_where_nothing_is_played_there_is_nothing_to_control(viewer: Viewer) -> None:
    viewer.control(play=True)
    assert viewer.statuses() == ["playback control: no recording is played here (rwt bag play)"]
