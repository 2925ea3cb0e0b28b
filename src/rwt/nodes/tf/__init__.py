"""tf2_web_republisher: the transforms a page asks for, as often as it asks and where they have moved."""

from rwt.nodes.tf.republisher import Tf2WebRepublisher

__all__ = ["Tf2WebRepublisher"]
