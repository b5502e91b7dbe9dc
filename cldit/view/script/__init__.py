"""JavaScript of the page, a file a subject; `cldit.view.page` puts it in."""
