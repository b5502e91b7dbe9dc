"""Plan -> runner -> record."""
