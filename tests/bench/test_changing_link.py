"""Runs over changing links: what is kept of them, and one short run with Chromium."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from bench.network import changing_link
from bench.network.changing_link import CASES, RECORD, Case, Run, Seen, draw, measure, read_runs, table
from rwt_webrtc.packets.ice_guard import CONSENT_EXPIRES_SECONDS
from tests.browser.driver import find_browser

HAS_NAMESPACES = os.path.exists("/dev/net/tun") and shutil.which("ip") is not None and os.geteuid() == 0


def test_an_image_grows_older_until_the_next_one() -> None:
    seen = Seen([(0.15, 0.1, 640), (1.05, 0.2, 640)], [8000.0] * 20)
    ages = seen.shown_ages(2.0)
    assert len(ages) == 20
    assert ages[1] == pytest.approx(0.15)  # The first image, 0.1 s old, replaces one of the beginning.
    assert ages[9] == pytest.approx(1.0 - 0.05)
    assert ages[10] == pytest.approx(1.05 - 0.05)
    assert ages[-1] == pytest.approx(2.0 - 0.85)
    assert seen.series(2.0)[2] == (8, 1, 1.0)


def test_an_older_image_than_the_one_before_does_not_count() -> None:
    seen = Seen([(0.5, 0.1, 640), (0.6, 0.5, 640)], [0.0] * 10)
    assert seen.shown_ages(1.0)[-1] == pytest.approx(0.6)


def test_the_table_has_each_figure_of_each_case(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    assert read_runs(path) == []
    runs = [Run("bursts", "mjpeg", seed, {"median age": age}, []) for seed, age in enumerate((0.1, 0.3, 0.2))]
    path.write_text("".join(json.dumps(asdict(run)) + "\n" for run in runs))
    assert (
        table(read_runs(path)).splitlines()[2] == "| bursts | mjpeg | 3 | median age | 0.20 | 0.28 | 0.30 |"
    )


def test_the_recorded_runs_are_those_of_the_plots(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    runs = [run for run in read_runs(RECORD) if run.case == "cut"]
    assert len(runs) >= 10
    draw("cut", runs, tmp_path / "link-cut.svg")
    plot = (tmp_path / "link-cut.svg").read_text()
    assert "sent, kbit/s" in plot and "age of the image, s" in plot


@pytest.mark.browser
@pytest.mark.skipif(not HAS_NAMESPACES, reason="needs root, `ip` and /dev/net/tun")
@pytest.mark.skipif(find_browser() is None, reason="needs Chromium")
@pytest.mark.parametrize("way", ["webrtc", "mjpeg"])
def test_the_video_goes_on_after_an_outage(monkeypatch: pytest.MonkeyPatch, way: str) -> None:
    monkeypatch.setattr(changing_link, "WARM_UP", 2.0)
    good = CASES["cut"].steps[0][1]
    # Longer than a peer that may drive is waited for.
    back = 2 + CONSENT_EXPIRES_SECONDS + 2
    case = Case(((0, good), (2, replace(good, loss=1.0)), (back, good)), back + 11)
    seen = measure(way, case, 0)
    times = [at for at, _, _ in seen.images]
    assert any(at < 2 for at in times)
    # What was under way arrives; nothing else does until the link is back.
    assert not any(3.5 < at < back for at in times)
    assert any(at > back for at in times)
    assert min(seen.ages(back, case.end)) < 3
