"""The contract of drivers, for tests and for `cldit check-driver`.

`cameras`, `wheels`, `backgrounds` and `triggers` check a device of that kind,
`lost_replies` any driver connected to an emulator whose replies can be lost or damaged. `run` runs
it, on emulators or, as far as that is safe, on an instrument. A violation raises
`cldit.testing.expect.ContractBroken`.
"""
