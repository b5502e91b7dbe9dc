"""Reports of runs, evaluations, series, sprays and recordings."""

from cldit.io.caches import use_caches

use_caches()  # matplotlib needs a folder when it is imported
