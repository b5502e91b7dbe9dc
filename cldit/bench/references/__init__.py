"""Reference images of `budget`; `python -m tests.bench budget_reference` makes them."""
