"""Converged pictures that the budget is compared with; tests/bench/budget_reference.py."""
