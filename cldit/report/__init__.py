"""Pictures and the report."""

from cldit.caches import use_caches

use_caches()  # before matplotlib is imported: it needs a folder
