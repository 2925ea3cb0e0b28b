"""The journeys of the docs succeed with the commands of this environment."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.docs.processes import commands_folder
from tests.journeys.__main__ import JOURNEYS, replay

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]


@pytest.mark.parametrize("name", JOURNEYS)
def test_a_journey(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "journey"
    folder.mkdir()
    path = f"{commands_folder(tmp_path / 'bin')}{os.pathsep}{os.environ['PATH']}"
    journey = replay(name, folder, path)
    assert journey.code == 0, journey.output
    assert journey.commands >= 3
