"""A client in a process of its own, to be killed or stopped: `python -m tests.faults.program PORT WHAT`.

It offers the service `/doomed`, subscribes to `/talk`, does what it is told, prints a line, and waits.
"""

from __future__ import annotations

import json
import sys
import time

from tests.core.transports.rfc6455.frames import text
from tests.faults.blocking_client import BlockingClient

MOST_SECONDS = 20.0


def main() -> None:
    """Never ends well."""
    port, what = int(sys.argv[1]), sys.argv[2]
    with BlockingClient(port) as client:
        client.say("advertise_service", service="/doomed", type="std_srvs/SetBool")
        client.say("subscribe", topic="/talk", type="std_msgs/String")
        client.ask_something()
        if what == "half a frame":
            publish = {
                "op": "publish",
                "topic": "/talk",
                "type": "std_msgs/String",
                "msg": {"data": "x" * 99_000},
            }
            client.socket.sendall(text(json.dumps(publish))[:50_000])
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        time.sleep(MOST_SECONDS)


if __name__ == "__main__":
    main()
