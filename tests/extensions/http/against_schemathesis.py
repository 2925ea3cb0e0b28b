"""Plays schemathesis, which makes requests from the document, against a server: ``make schemathesis``.

Left out is what it would call mistakes and are decisions: an integer written as ``1.0`` is refused, as ROS
refuses it, and a service that fails or a topic that is silent is answered with 502 and 504. An error of ours,
500, is text and no problem, which the check of content types finds.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from rwt import Server
from tests.extensions.http.conftest import Robot

CHECKS = (
    "status_code_conformance",
    "content_type_conformance",
    "response_schema_conformance",
    "negative_data_rejection",
)


def main() -> int:
    """The exit code of schemathesis."""
    beside = Path(sys.executable).with_name("schemathesis")
    program = str(beside) if beside.exists() else shutil.which("schemathesis")
    if program is None:
        sys.exit("schemathesis is not installed: pip install --group schemathesis")
    server = Server("ws://127.0.0.1:0", extra_nodes=[Robot], web={"enabled": False})
    with server:
        base = server.urls[0].replace("ws:", "http:", 1)
        command = [program, "run", f"{base}/api/openapi.json", "--phases", "coverage,fuzzing",
                   "--suppress-health-check", "filter_too_much"]  # fmt: skip
        return subprocess.run([*command, "--checks", ",".join(CHECKS), *sys.argv[1:]], check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
