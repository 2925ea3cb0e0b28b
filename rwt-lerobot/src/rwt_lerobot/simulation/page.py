"""Page with a slider for each joint and the images of the cameras, at `/arm`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from rwt_lerobot.joints.limits import JointLimit
from rwt_transports.http.routes import Audience, HttpExtension, HttpResponse, Route


def sliders_page(
    states: str, commands: str, limits: Sequence[JointLimit], cameras: Mapping[str, str]
) -> HttpExtension:
    """Return the page of an arm.

    Args:
        states: topic of the joint states.
        commands: topic of the trajectories.
        limits: limits of the joints.
        cameras: topics of the images, without `/compressed`, by the name of the camera.
    """
    arm = {
        "states": states,
        "commands": commands,
        "joints": [{"name": each.name, "lower": each.lower, "upper": each.upper} for each in limits],
        "cameras": cameras,
    }
    text = Path(__file__).with_name("sliders.html").read_text(encoding="utf-8")
    data = json.dumps(arm).replace("<", "\\u003c")
    body = text.replace("/* ARM */ {}", data).encode()

    def show(request: object, reader: object) -> HttpResponse:
        return HttpResponse(body, content_type="text/html; charset=utf-8")

    return HttpExtension(routes=(Route("/arm", show, Audience.ADMITTED),))
