"""The journeys of the docs succeed with the commands of this environment."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.journeys.__main__ import JOURNEYS, SKIPPED, local_path, replay

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]


@pytest.mark.parametrize("name", JOURNEYS)
def test_a_journey(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "journey"
    folder.mkdir()
    journey = replay(name, folder, local_path(tmp_path / "bin"))
    if journey.code == SKIPPED:
        pytest.skip(journey.output)
    assert journey.code == 0, journey.output
    assert journey.commands >= 3
