"""`examples/demonstrations.py`: demonstrators in processes of their own, and the report of them."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import pytest

from teaching.plan import Camera
from teaching.report import Teaching, percentile, table
from tests.docs.blocks import ROOT
from tests.docs.processes import Running, commands_folder

_PROGRAM = ROOT / "examples" / "demonstrations.py"
_PATIENCE = 300.0

TEACHING = Teaching("robot1", 10.0, 295, (0.02, 0.01, 0.03), 100, 198, 200, (0.03, 0.05), 10, 2.5)


@pytest.mark.timeout(400)
def test_two_demonstrators_teach_at_once() -> None:
    options = "--demonstrators 2 --seconds 2 --camera-size 160x120"
    done = _run(_PROGRAM.name, *options.split())
    assert (done.returncode, done.stderr) == (0, "")
    rows = [line.split() for line in done.stdout.splitlines() if line.startswith("robot")]
    assert [row[0] for row in rows] == ["robot1", "robot2"]
    for _, pictures, age, transforms, joints, commands, median, _, _, waypoints in rows:
        # What is reached depends on the machine; that all of it goes on at once does not.
        assert 0 < float(pictures) <= 31
        assert 0 < float(transforms) <= 10.5
        assert 0 < float(joints) <= 21
        assert 0 < float(commands) <= 21
        assert float(age) >= 0 and float(median) > 0
        assert int(waypoints) >= 1
    assert "command → effect of all: p50 " in done.stdout
    assert "nan" not in done.stdout


@pytest.mark.timeout(400)
def test_ctrl_c_ends_it_all(tmp_path: Path) -> None:
    command = [sys.executable, str(_PROGRAM), "--demonstrators", "1", "--seconds", "60"]
    with Running(command, tmp_path, commands_folder(tmp_path / "commands"), limit=_PATIENCE) as program:
        program.wait_for("1 demonstrators teach for 60 s at ws://127.0.0.1:")
        program.interrupt()
        program.expect_end(130)


def test_percentiles_and_the_table() -> None:
    assert [percentile([4.0, 1.0, 3.0, 2.0], each) for each in (0, 25, 50, 51, 100)] == [
        1.0,
        1.0,
        2.0,
        3.0,
        4.0,
    ]
    assert math.isnan(percentile([], 50))

    lines = table([TEACHING, TEACHING], 7.5, Camera(320, 240, 30.0)).splitlines()
    assert lines[2].split() == ["robot1", "29.5", "20", "10.0", "19.8", "20.0", "30", "/", "50", "10"]
    assert lines[4].split() == ["at", "most", "30.0", "10.0", "20.0", "20.0"]
    assert lines[6:] == [
        "command → effect of all: p50 30 ms, p95 50 ms",
        "CPU of the server, with robots, cameras and encoders: 0.75 cores",
        "CPU of the demonstrators: 0.50 cores",
    ]
    assert len({len(line) for line in (lines[0], lines[2])}) == 1


@pytest.mark.parametrize(
    ("program", "line", "complaint"),
    [
        ("demonstrations", "--demonstrators 0", "'0' is not a number from 1 to 100"),
        ("demonstrations", "--seconds -1", "-1: it must be above 0 and at most 3600"),
        ("demonstrations", "--seconds nan", "nan: it must be above 0 and at most 3600"),
        ("demonstrations", "--camera-size 320", "'320' is not WIDTHxHEIGHT, as 320x240"),
        ("pybullet_robot", "--size big", "'big' is not WIDTHxHEIGHT, as 640x480"),
        ("pybullet_robot", "--size 9999x480", "9999x480: width and height must be from 16 to 1920"),
        ("pybullet_robot", "--camera-rate 0", "0: the rate must be above 0 and at most 100"),
    ],
)
def test_options_that_make_no_sense(program: str, line: str, complaint: str) -> None:
    done = _run(f"{program}.py", *line.split())
    assert (done.returncode, complaint in done.stderr) == (2, True), done.stderr


def _run(program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(ROOT / "examples" / program), *arguments],
        env={"PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
        timeout=_PATIENCE,
        check=False,
    )
