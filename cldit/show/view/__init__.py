"""Runs and measurements as one page for the browser, without server or network."""

from cldit.show.view.folders import view_items
from cldit.show.view.item import Item
from cldit.show.view.page import page_html, save_page

__all__ = ["Item", "page_html", "save_page", "view_items"]
