"""The robot in a Django project with Channels, which an ASGI server runs in the tests."""

from __future__ import annotations

import django
from channels.routing import ProtocolTypeRouter, URLRouter
from django.conf import settings
from django.http import HttpRequest, JsonResponse
from django.urls import path, re_path

settings.configure(ALLOWED_HOSTS=["*"], ROOT_URLCONF=__name__, SECRET_KEY="of a test", MIDDLEWARE=[])
django.setup()

from django.core.asgi import get_asgi_application  # noqa: E402 - needs configured settings

from tests.extensions.asgi.apps import alone  # noqa: E402 - follows the import before


def shop(request: HttpRequest) -> JsonResponse:
    """A page of the project's own."""
    return JsonResponse({"label": "shop"})


urlpatterns = [path("shop", shop)]

_below = re_path(r"^shop/robot/", alone)
application = ProtocolTypeRouter(
    {
        "http": URLRouter([_below, re_path(r"", get_asgi_application())]),
        "websocket": URLRouter([_below]),
        # Channels hands on what it names: the robot lives as long as the server.
        "lifespan": alone,
    }
)
