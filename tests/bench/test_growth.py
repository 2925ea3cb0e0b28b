"""Conclusions about growth, and a short measurement of each curve."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bench import growth
from bench.growth import CURVES, Curve, Found


def found(points: tuple[int, ...], *costs: float) -> Found:
    curve = Curve("name", "Title", "things", points, points, {})
    return Found(curve, points, {"series": list(costs)})


@pytest.mark.parametrize(
    ("costs", "exponent"),
    [((5.0, 5.0, 5.0), 0.0), ((5.0, 50.0, 500.0), 1.0), ((5.0, 5.0, 500.0), 2.0), ((5.0, 4.0, 3.0), -0.097)],
)
def test_the_steepest_stretch_decides(costs: tuple[float, ...], exponent: float) -> None:
    assert found((1, 10, 100), *costs).steepest("series") == pytest.approx(exponent, abs=0.01)


def test_points_that_are_near_each_other_are_not_compared() -> None:
    assert found((1, 2, 4, 5), 10.0, 20.0, 20.0, 40.0).steepest("series") == pytest.approx(1.0)


def test_none_of_something_has_no_exponent() -> None:
    assert found((0, 1, 10), 1.0, 1000.0, 1000.0).steepest("series") == 0.0


def test_a_steep_curve_fails_the_check(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    curve = Curve("square", "Square", "things", (1, 10), (1, 10), {"cost": lambda x, _: float(x * x)})
    line = Curve("line", "Line", "things", (1, 10), (1, 10), {"cost": lambda x, _: float(x)})
    monkeypatch.setattr(growth, "CURVES", (curve, line))
    assert growth.main(["--check", "--rounds", "1"]) == 1
    assert "steeper than linear: square, cost: exponent 2.00" in capsys.readouterr().out
    assert growth.main(["--check", "--rounds", "1", "--only", "line"]) == 0


@pytest.mark.timeout(120)
@pytest.mark.parametrize("name", [curve.name for curve in CURVES])
def test_each_curve_can_be_measured(name: str, tmp_path: Path) -> None:
    file = tmp_path / "figures.json"
    growth.main(["--tiny", "--rounds", "1", "--seconds", "0.02", "--only", name, "--json", str(file)])
    figures = json.loads(file.read_text(encoding="utf-8"))[name]
    for costs in figures["costs"].values():
        assert len(costs) == len(figures["points"])
        assert all(cost > 0 for cost in costs)


def test_a_curve_is_drawn_as_svg(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    file = tmp_path / "curve.svg"
    growth.draw(found((0, 1, 10, 100), 1.0, 2.0, 3.0, 4.0), file)
    assert "<svg" in file.read_text(encoding="utf-8")
