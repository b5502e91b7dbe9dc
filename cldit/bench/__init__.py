"""Error of T_app against run time, of whole runs and of single traces, on this machine."""

PARTS = ("budget", "error")
ACCURACIES_K = (1.0, 0.3, 0.1, 0.05)  # default accuracies of `source` in `error`
ASKED_K = (4.0, 2.0, 1.0)  # default tolerances of `budget`
BUDGET_SCENES = (  # with a reference
    "gdi",
    "gdi-flow",
    "droplets-only",
    "methane-jet",
    "imported",
    "even-grid",
    "random-grid",
)
