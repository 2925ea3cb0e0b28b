"""`rwt serve --tls auto`: what it prints, and whom a phone meets there."""

from __future__ import annotations

import itertools
import os
import pty
import ssl
import subprocess
import sys
import urllib.request
from pathlib import Path

import numpy as np
import pytest

from rwt.cli.commands.serve.tls import qr_code
from rwt.tls.machine import machine_addresses
from tests.processes import LONGEST, ROOT, running, start

_LIGHT = {"█": (1, 1), "▀": (1, 0), "▄": (0, 1), " ": (0, 0)}


def _read_code(lines: list[str]) -> str:
    """Return the content of a QR code drawn with light blocks on a dark terminal."""
    import cv2  # Not in the dependency group test.

    width = max(map(len, lines))
    rows = []
    for line in lines:
        halves = [_LIGHT[each] for each in line.ljust(width)]
        rows += [[upper for upper, _ in halves], [lower for _, lower in halves]]
    picture = np.kron(np.array(rows, dtype=np.uint8) * 255, np.ones((8, 8), dtype=np.uint8))
    text: str = cv2.QRCodeDetector().detectAndDecode(picture)[0]
    return text


@pytest.mark.extended
def test_a_camera_reads_the_address() -> None:
    address = "https://192.168.178.42:9090/"
    assert _read_code(qr_code(address).splitlines()) == address


def test_the_page_and_the_authority_are_had_by_https(tmp_path: Path) -> None:
    environment = {"XDG_STATE_HOME": str(tmp_path)}
    with running("serve", "--tls", "auto", "wss://127.0.0.1:0", environment=environment) as (process, url):
        assert process.stdout is not None
        page = process.stdout.readline().removeprefix("page: ").strip()
        assert page == url.replace("wss", "https", 1) + "/"
        authority = tmp_path / "rwt" / "tls" / "authority.crt"
        said = "".join(process.stdout.readline() for _ in range(3))
        assert f"{page}tls/authority.crt" in said
        assert "only this machine reaches it" in said
        trust = ssl.create_default_context(cafile=authority)
        with urllib.request.urlopen(f"{page}tls/authority.crt", context=trust, timeout=LONGEST) as answer:
            assert answer.headers["Content-Type"] == "application/x-x509-ca-cert"
            assert answer.read() == authority.read_bytes()


@pytest.mark.extended
def test_a_terminal_is_shown_a_code(tmp_path: Path) -> None:
    reached_at = next((str(each) for each in machine_addresses() if not each.is_loopback), "")
    if ":" in reached_at or not reached_at:
        pytest.skip("this machine is in no network of IPv4")
    own, other = pty.openpty()
    words = ("serve", "--tls", "auto", "wss://0.0.0.0:0", *_settings(tmp_path, reached_at))
    process = start(*words, stdout=other, stderr=subprocess.DEVNULL)
    os.close(other)
    try:
        with os.fdopen(own, encoding="utf-8") as terminal:
            lines = iter(terminal.readline, "")
            page = next(line for line in lines if line.startswith("page: ")).removeprefix("page: ").strip()
            code = [next(line for line in lines if "█" in line).rstrip("\n")]
            code += [
                line.rstrip("\n")
                for line in itertools.takewhile(lambda line: set(line.strip()) != {"▀"}, lines)
            ]
    finally:
        process.terminate()
        process.wait(LONGEST)
    assert page.startswith(f"https://{reached_at}:")
    assert _read_code(code) == page, "\n".join(code)


def _settings(folder: Path, name: str) -> list[str]:
    return ["--set", f"tls.names={name}", "--set", f"tls.folder={folder}"]


def test_without_the_extra_it_is_said_how_to_have_it(tmp_path: Path) -> None:
    code = (
        "import sys; sys.modules['ifaddr'] = None\n"
        "from rwt.cli import main; sys.exit(main(['serve', '--tls', 'auto', '--set', sys.argv[1]]))"
    )
    found = subprocess.run(
        [sys.executable, "-c", code, f"tls.folder={tmp_path}"],
        capture_output=True,
        text=True,
        timeout=LONGEST,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        check=False,
    )
    assert found.returncode == 2, found.stderr
    assert "pip install 'robot-web-tools[tls]'" in found.stderr
