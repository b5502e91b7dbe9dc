"""Pictures and the report."""

from cldit.io.caches import use_caches

use_caches()  # before matplotlib is imported: it needs a folder
