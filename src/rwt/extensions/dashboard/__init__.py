"""Dashboard, widgets for other pages, and layouts, over HTTP."""

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt.extensions.dashboard.files import MISSING as MISSING
    from rwt.extensions.dashboard.files import StaticFiles as StaticFiles
    from rwt.extensions.dashboard.files import find_static_files as find_static_files
    from rwt.extensions.dashboard.page import WebPage as WebPage
    from rwt.extensions.dashboard.page import WebPageError as WebPageError

__all__, __getattr__, __dir__ = exports(
    __name__,
    {
        "rwt.extensions.dashboard.files": ("MISSING StaticFiles find_static_files"),
        "rwt.extensions.dashboard.page": ("WebPage WebPageError"),
    },
)
