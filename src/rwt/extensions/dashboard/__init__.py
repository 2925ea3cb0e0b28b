"""Dashboard, widgets for other pages, and layouts, over HTTP."""

from rwt.extensions.dashboard.files import MISSING, StaticFiles, find_static_files
from rwt.extensions.dashboard.page import WebPage, WebPageError

__all__ = ["WebPage", "WebPageError", "StaticFiles", "find_static_files", "MISSING"]
