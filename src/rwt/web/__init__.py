"""Dashboard, widgets for other pages, and layouts, over HTTP."""

from rwt.web.page import MISSING, StaticFiles, WebPage, WebPageError, find_static_files

__all__ = ["WebPage", "WebPageError", "StaticFiles", "find_static_files", "MISSING"]
