"""One target under the coverage-guided fuzzer: `python -m tests.fuzz.one TARGET [libFuzzer options]`."""

from __future__ import annotations

import sys

import atheris

INSTRUMENTED = [
    "rwt_protocol", "rwt_transports", "rwt_interfaces", "rwt_graph", "rwt.rosbridge", "rwt.media",
    "rwt.extensions.recording", "aiortc", "aioice", "mcap",
]  # fmt: skip
with atheris.instrument_imports(include=INSTRUMENTED):
    from tests.fuzz.targets import TARGETS


def main() -> None:
    """Never returns: the fuzzer ends the process."""
    program, name, *options = sys.argv
    atheris.Setup([program, *options], lambda data: TARGETS[name](data or b"\0"))
    atheris.Fuzz()


if __name__ == "__main__":
    main()
