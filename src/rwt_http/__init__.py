"""The HTTP gateway: topics, services, actions and parameters as resources, with their types as OpenAPI."""

from rwt_http.gateway import HttpGateway
from rwt_http.settings import HttpSettings

__all__ = ["HttpGateway", "HttpSettings"]
