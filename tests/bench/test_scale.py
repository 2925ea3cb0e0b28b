"""Computed costs of a fleet."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.fleet.scale import MACHINES, Constants, Fleet, copies, cost, main, table, totals

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "scale.md"


def test_the_page_says_what_the_program_computes() -> None:
    text = PAGE.read_text(encoding="utf-8")
    fleet, constants = Fleet(), Constants()
    assert totals(fleet, constants) in text
    for by_robot in (False, True):
        assert table(fleet, constants, MACHINES, by_robot=by_robot) in text


def test_a_message_is_copied_to_each_process_with_a_viewer() -> None:
    assert copies(1, 10) == 1
    assert copies(2, 1) == pytest.approx(1)
    assert copies(2, 2) == pytest.approx(1.5)
    assert copies(1000, 10) == pytest.approx(10, abs=0.05)


def test_a_process_bears_its_share() -> None:
    fleet = Fleet(robots=10, topics=2, viewers=3, hertz=5.0, processes=2)
    constants = Constants(
        delivery_us=1000,
        arrival_busy_us=2000,
        arrival_quiet_us=4000,
        learned_kb=100,
        client_kb=10,
        idle_mb=50,
    )
    each = cost(fleet, constants, 1, by_robot=True)
    assert (each.processes, each.clients, each.arrivals, each.links) == (2, 15, 50, 5)
    assert each.busy == pytest.approx(150 * 0.001 + 50 * 0.002)
    assert each.quiet == pytest.approx(150 * 0.001 + 50 * 0.004)
    assert each.memory_mb == pytest.approx(50 + 0.5 + 0.15)
    anywhere = cost(fleet, constants, 1, by_robot=False)
    assert anywhere.arrivals == pytest.approx(100 * 1.75 / 2)
    assert anywhere.links == 11


def test_other_constants_and_fleets(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--robots", "10", "--delivery-us", "1"]) == 0
    assert "20,000 deliveries a second" in capsys.readouterr().out
