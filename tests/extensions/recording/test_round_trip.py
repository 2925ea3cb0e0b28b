"""Recorded, played and recorded again, a recording is the same."""

from __future__ import annotations

from pathlib import Path

import pytest

from rwt.extensions.recording import Encoding, RecordingOptions, open_recording, record_graph
from rwt.extensions.recording.playback import Player
from rwt_graph import MemoryGraph, SimulatedClock
from rwt_interfaces import Registry
from tests.extensions.recording.robots import OWN, START_NS, of_topic, record_robot, rows

FORMS = [(distro, encoding) for distro in ("jazzy", "noetic") for encoding in ("ros", "json")]


@pytest.mark.parametrize(("distro", "encoding"), FORMS)
def test_a_recording_played_and_recorded_again_is_the_same(
    tmp_path: Path, distro: str, encoding: Encoding
) -> None:
    first, second = tmp_path / "first.mcap", tmp_path / "second.mcap"
    record_robot(first, distro, encoding)
    with open_recording([first]) as recording:
        clock = SimulatedClock(recording.start_ns)
        graph = MemoryGraph(Registry(recording.distro), clock)
        with Player(graph, recording) as player, record_graph(graph, second, OWN, RecordingOptions(encoding)):
            clock.advance(10.0)
            assert player.finished.is_set()
    before, after = rows(first), rows(second)
    assert len(before) == 26
    # What was kept from before the recording was published then, which a simulated clock cannot say again.
    assert [row for row in before if row[0] != "/map_name"] == [row for row in after if row[0] != "/map_name"]
    ((_, _, logged, published, _, data),) = of_topic(before, "/map_name")
    assert (logged, published) == (START_NS + 3_500_000_000, START_NS)
    assert [(row[2], row[5]) for row in of_topic(after, "/map_name")] == [(logged, data)]
