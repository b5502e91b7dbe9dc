"""`cldit view`: runs and measurements as one page for the browser, without server or network."""

from cldit.view.folders import view_items
from cldit.view.item import Item
from cldit.view.page import page_html, save_page

__all__ = ["Item", "page_html", "save_page", "view_items"]
