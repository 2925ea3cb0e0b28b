"""tf2_web_republisher: transforms that a page requests, at its rate and only if they have moved."""

from rwt.extensions.tf_stream.republisher import Tf2WebRepublisher

__all__ = ["Tf2WebRepublisher"]
