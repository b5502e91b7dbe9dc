"""What every driver must do, whoever made it; tests and `cldit check-driver` use this one.

`cameras`, `backgrounds`, `triggers` and `devices` ask of a device of that kind, `pulses` of a
generator whose pulses can be seen, `together` of a whole rig, `lost_replies` of any driver before
an emulator whose replies can be lost or spoiled. `instrument` is the part that is safe before
real ones. What is broken is `cldit.testing.expect.ContractBroken`.
"""
