"""The HTTP gateway: topics, services, actions and parameters as resources, with their types as OpenAPI."""

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt.extensions.http.gateway import HttpGateway as HttpGateway
    from rwt.extensions.http.part import HttpSettings as HttpSettings

__all__, __getattr__, __dir__ = exports(
    __name__, {"rwt.extensions.http.gateway": "HttpGateway", "rwt.extensions.http.part": "HttpSettings"}
)
