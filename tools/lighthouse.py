"""Audit the dashboard with Lighthouse, as a phone and as a desktop.

    make lighthouse

Prints the scores and the times, and fails if one of accessibility, best practices and SEO is below 100. Needs
npx and Chromium. The score of performance is not checked: a page that shows a camera never finishes loading.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

VERSION: Final = "12.8.2"
COMPLETE: Final = ("accessibility", "best-practices", "seo")
TIMES: Final = ("first-contentful-paint", "total-blocking-time", "cumulative-layout-shift")
BROWSERS: Final = ("chromium", "chromium-browser", "google-chrome")


def audit(url: str, *options: str) -> bool:
    """Print the scores of a page; returns True if those of `COMPLETE` are 100."""
    chromium = next(filter(None, map(shutil.which, BROWSERS)), "")
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        flags = "--chrome-flags=--headless=new --no-sandbox --disable-gpu"
        command = ["npx", "--yes", f"lighthouse@{VERSION}", url, "--quiet", "--output=json", flags]
        subprocess.run(
            [*command, f"--output-path={report}", *options],
            check=True,
            env={"CHROME_PATH": chromium, **os.environ},
        )
        found = json.loads(report.read_text(encoding="utf-8"))
    scores = {name: round(100 * each["score"]) for name, each in found["categories"].items()}
    times = {name: found["audits"][name]["displayValue"] for name in TIMES}
    print(*options, *(f"{name} {value}" for name, value in (scores | times).items()), sep="\n  ")
    for name in COMPLETE:
        for each in found["categories"][name]["auditRefs"]:
            details = found["audits"][each["id"]]
            if each["weight"] and details["score"] is not None and details["score"] < 1:
                print(f"  {name}: {details['title']}", file=sys.stderr)
    return all(scores[name] == 100 for name in COMPLETE)


def main() -> int:
    """Audit the page of the demo robot."""
    serve = [sys.executable, "-m", "rwt.cli", "serve", "--demo", "ws://127.0.0.1:0"]
    with subprocess.Popen(serve, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            # Of a phone, the slow network and processor are applied: an estimate from a fast load takes every
            # script that runs before the first image for a condition of it.
            phone = "--throttling-method=devtools"
            url = server.stdout.readline().split()[-1].replace("ws", "http", 1)
            return 0 if audit(url, phone) & audit(url, "--preset=desktop") else 1
        finally:
            server.terminate()


if __name__ == "__main__":
    sys.exit(main())
