"""The tutorial "An arm in your browser in five minutes": its commands, and the browser. Needs MuJoCo."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import anyio
import pytest

from rwt import connect
from tests.browser.driver import LEFT_STREAM, find_browser, opened_browser
from tests.browser.test_joints import DRAWN, slide_until

if find_spec("mujoco") is None:  # Not imported here: it reads MUJOCO_GL, which the model sets.
    pytest.skip("MuJoCo is not installed", allow_module_level=True)

PAGE: Final = Path(__file__).parents[2] / "docs" / "how-to" / "lerobot.md"


def _steps() -> list[str]:
    """Return the commands of the tutorial's second block, each on a line."""
    part = PAGE.read_text(encoding="utf-8").split("## An arm in your browser")[1].split("\n## ")[0]
    blocks = re.findall(r"```sh\n(.*?)```", part, re.S)
    assert "rwt lerobot mujoco" in blocks[0]
    steps: list[str] = blocks[1].replace("\\\n", "").strip().splitlines()
    return steps


async def _browse(url: str, folder: Path) -> None:
    """Do what the tutorial says about the dashboard: move a slider, hold, and stop."""
    kind = find_browser()
    if kind is None:
        pytest.skip("Chromium is not installed")
    arm: dict[str, float] = {}
    async with connect(url) as robot:
        robot.subscribe(
            "/joint_states", lambda state: arm.update(zip(state.name, state.position, strict=True)),
            "sensor_msgs/JointState",
        )  # fmt: skip
        with opened_browser(kind, folder) as browser:
            async with browser.page(url.replace("ws", "http", 1) + "/", 1300, 900) as page:
                page.forgive(LEFT_STREAM)
                for kind_of_panel in ("scene", "camera", "joints"):
                    await page.wait(f"document.querySelector('.panel-{kind_of_panel}')")
                await page.wait("document.querySelectorAll('.jog .limit').length === 6")
                await slide_until(page, "shoulder_pan", 0.8, lambda: abs(arm["shoulder_pan"] - 0.8) < 0.05)
                await page.wait(f"Math.abs({DRAWN.format('shoulder_pan')} - 0.8) < 0.1")
                await page.wait("document.querySelector('.camera canvas')?.width > 0")
                await slide_until(page, "shoulder_pan", -1.8, lambda: arm["shoulder_pan"] < 0.5)
                await page.click(".joints .row button")
                await anyio.sleep(0.5)
                held = arm["shoulder_pan"]
                assert held > -1.7
                await anyio.sleep(0.5)
                assert arm["shoulder_pan"] == pytest.approx(held, abs=0.02)
                await page.keyboard("press", "Escape")
                await page.wait("!document.querySelector('.jog input:enabled')")


def test_the_tutorial(tmp_path: Path) -> None:
    # The verb by itself: a checkout that is not installed has no entry points.
    command = [
        sys.executable, "-c",
        ("import sys; from rwt_lerobot.commands.mujoco import add_mujoco_verb;"
        "from rwt.cli.parser import Parser, add_commands; parser = Parser(prog='rwt');"
        "add_mujoco_verb(add_commands(parser));"
        "given = parser.parse_args(['mujoco', 'ws://127.0.0.1:0']); sys.exit(given.run(given))"),
    ]  # fmt: skip
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=tmp_path) as server:
        assert server.stdout is not None
        url = server.stdout.readline().split()[-1]
        try:
            anyio.run(_browse, url, tmp_path)
            printed = [
                subprocess.run(
                    step.replace("rwt", f"{sys.executable} -m rwt.cli", 1),
                    shell=True,
                    capture_output=True,
                    text=True,
                    timeout=60,
                    env={**os.environ, "RWT_URL": url},
                )
                for step in _steps()
            ]
        finally:
            server.terminate()
    assert [each.returncode for each in printed] == [0, 0, 0], [each.stderr for each in printed]
    assert "shoulder_pan" in printed[0].stdout
    assert "SUCCEEDED" in printed[1].stdout
    assert "success" in printed[2].stdout
