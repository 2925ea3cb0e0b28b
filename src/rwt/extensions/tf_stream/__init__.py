"""tf2_web_republisher: transforms that a page requests, at its rate and only if they have moved."""

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt.extensions.tf_stream.republisher import Tf2WebRepublisher as Tf2WebRepublisher

__all__, __getattr__, __dir__ = exports(
    __name__,
    {
        "rwt.extensions.tf_stream.republisher": ("Tf2WebRepublisher"),
    },
)
