"""JavaScript of the page, a file a subject; `cldit.show.view.page` puts it in."""
