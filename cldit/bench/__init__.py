"""What this computer can do: error against run time, growth, memory, the kernels' roofline."""

# In the order of the page.
PARTS = (
    "budget", "error", "growth", "memory", "leave-out", "roofline", "solver", "rays", "ablation",
    "import",
    "mitsuba",
)  # fmt: skip

ACCURACIES_K = (1.0, 0.3, 0.1, 0.05)
"""What `source` is asked for where nothing else is said."""

ASKED_K = (4.0, 2.0, 1.0, 0.5)
"""Errors of the picture that `budget` asks for where nothing else is said."""

BUDGET_SCENES = ("gdi", "gdi-flow", "droplets-only", "even-grid", "random-grid")
"""Scenes of which `budget` has true pictures."""
