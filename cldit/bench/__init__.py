"""True and stated error of T_app against run time of whole runs, on this machine."""

ASKED_K = (4.0, 2.0, 1.0)  # default tolerances of a run
BUDGET_SCENES = (  # with a reference
    "gdi-cone",
    "gdi",
    "droplets-only",
    "methane-jet",
    "imported",
    "even-grid",
    "random-grid",
)
