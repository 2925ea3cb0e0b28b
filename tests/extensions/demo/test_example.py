"""The example program runs as it stands."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[3] / "examples" / "drive_square.py"


def test_the_square_is_driven_and_closed(capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    lines = capsys.readouterr().out.splitlines()
    places = [tuple(float(part[2:]) for part in line.split()[2:]) for line in lines]
    assert len(places) == 4
    assert places[-1] == pytest.approx((0.0, 0.0), abs=0.1)
    assert places[0] == pytest.approx((1.0, 0.0), abs=0.1)
    assert places[1] == pytest.approx((1.0, 1.0), abs=0.1)
