"""Programs in other processes that run the statements that tests give them.

They may run on another Python, such as the system's, so this module imports only the standard library.
"""

from __future__ import annotations

import json
import subprocess
import sys
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

_ROOT: Final = Path(__file__).parent.parent

#: Prefix of the lines that are answers; ROS prints others.
_ANSWER: Final = "answer: "


class Program:
    """A program in another process, which calls :func:`run_statements`.

    Args:
        python: Python that runs it.
        module: its module.
        arguments: its arguments.
        environment: environment of the process.
        prefix: words before the command, such as those that run it in a network namespace.
    """

    def __init__(
        self,
        python: str,
        module: str,
        *arguments: str,
        environment: Mapping[str, str],
        prefix: Sequence[str] = (),
    ) -> None:
        self.process = subprocess.Popen(
            [*prefix, python, "-m", module, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
            cwd=_ROOT,
        )

    def run(self, statements: str) -> Any:
        """Run statements in the program; return the value that they give to `result`, if any.

        Raises:
            RuntimeError: they failed there; the text is the traceback.
        """
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(statements) + "\n")
        self.process.stdin.flush()
        line = ""
        while not line.startswith(_ANSWER):
            line = self.process.stdout.readline()
            if not line:
                raise RuntimeError("the program has ended")
        answer = json.loads(line.removeprefix(_ANSWER))
        if "failed" in answer:
            raise RuntimeError(answer["failed"])
        return answer["result"]

    def kill(self) -> None:
        """End the process without a farewell."""
        self.process.kill()
        self.process.wait()

    def close(self) -> None:
        """End the process."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.kill()
        self.process.stdout.close()


def run_statements(scope: dict[str, Any]) -> None:
    """Run statements from standard input until it ends.

    Args:
        scope: names that the statements see.
    """
    for line in sys.stdin:
        scope["result"] = None
        try:
            exec(json.loads(line), scope)
            answer = {"result": scope["result"]}
        except Exception:
            answer = {"failed": traceback.format_exc()}
        sys.stdout.write(_ANSWER + json.dumps(answer) + "\n")
        sys.stdout.flush()
