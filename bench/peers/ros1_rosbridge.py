"""rosbridge_suite of ROS 1 from a checkout of its branch `ros1`, which Debian does not package.

Arguments: folder of the checkout, and port. Needs Debian's packages autobahn, bson, pil, tornado and twisted
for Python 3. Its messages are generated with genpy into a temporary folder. It imports a service type of
rosauth, but does not use it without authentication: that is generated without fields.
"""

from __future__ import annotations

import runpy
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from socket import create_connection


def generate(folder: Path, package: str, kind: str, sources: list[Path]) -> None:
    """Generate the Python modules of a package's messages (`msg`) or services (`srv`)."""
    target, generator = folder / package / kind, f"/usr/lib/genpy/gen{kind}_py.py"
    target.mkdir(parents=True)
    (folder / package / "__init__.py").touch()
    search = []
    for known in ("std_msgs", "geometry_msgs"):
        search += ["-I", f"{known}:/usr/share/{known}/msg"]
    for source in {each.parent for each in sources}:
        search += ["-I", f"{package}:{source}"]
    for source in sources:
        subprocess.run(
            [sys.executable, generator, str(source), "-p", package, "-o", target, *search], check=True
        )
    subprocess.run([sys.executable, generator, "--initpy", "-p", package, "-o", target], check=True)


def report(port: int) -> None:
    """Print the address once the server accepts connections."""
    while True:
        try:
            create_connection(("127.0.0.1", port)).close()
        except OSError:
            time.sleep(0.1)
        else:
            print(f"listening on ws://127.0.0.1:{port}", flush=True)
            return


def main(checkout: Path, port: int) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        generate(folder, "rosbridge_msgs", "msg", sorted((checkout / "rosbridge_msgs/msg").glob("*.msg")))
        empty = folder / "Authentication.srv"
        empty.write_text("---\n", encoding="utf-8")
        generate(folder, "rosauth", "srv", [empty])
        sources = [str(checkout / each / "src") for each in ("rosbridge_library", "rosbridge_server")]
        sys.path[:0] = [str(folder), *sources]
        sys.argv = ["rosbridge_websocket", "--port", str(port), "--address", "127.0.0.1"]
        sys.argv.append("__name:=rosbridge_suite")  # Its default is the name of this project's node, too.
        threading.Thread(target=report, args=(port,), daemon=True).start()
        runpy.run_path(str(checkout / "rosbridge_server/scripts/rosbridge_websocket.py"), run_name="__main__")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
