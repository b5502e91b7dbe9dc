"""Protocol peers of instruments, for tests without hardware."""
