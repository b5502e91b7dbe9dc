"""Measured evaporation of single n-heptane droplets: a few points of each source, as printed."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Suspended:
    """A droplet held in gas at atmospheric pressure, d^2 against time."""

    source: str
    diameter_m: float
    temperature_K: float
    gas_temperature_K: float
    velocity_m_s: float
    time_s: tuple[float, ...]
    diameter2_mm2: tuple[float, ...]


@dataclass(frozen=True)
class Microgravity:
    """(d/d0)^2 against t/d0^2, in the range where it falls evenly."""

    gas_temperature_K: float
    time_s_mm2: tuple[float, ...]
    diameter2: tuple[float, ...]


# Nomura et al., Symp. (Int.) Combust. 26, 1267 (1996): n-heptane in nitrogen at 0.1 MPa in
# microgravity, 0.7 mm, 298 K, on a silica fibre; digitised for PeleLMeX (SingleDropEvap).
NOMURA_LIQUID_K = 298.0
NOMURA_Pa = 0.1e6
NOMURA = (
    Microgravity(
        gas_temperature_K=471.0,
        time_s_mm2=(2.048, 2.392, 2.710, 3.004, 3.382, 3.717, 4.062, 4.389, 4.724, 5.052, 5.387),
        diameter2=(0.835, 0.789, 0.747, 0.681, 0.644, 0.586, 0.532, 0.486, 0.425, 0.375, 0.302),
    ),
    Microgravity(
        gas_temperature_K=741.0,
        time_s_mm2=(0.962, 1.161, 1.360, 1.534, 1.750, 2.003, 2.164, 2.284),
        diameter2=(0.785, 0.703, 0.624, 0.550, 0.474, 0.359, 0.303, 0.258),
    ),
)

# Verwey and Birouk (2023): n-heptane at 1 atm, extrapolated to a fibre of no thickness, as a fit.
VERWEY_BIROUK_K = (473.0, 573.0, 673.0, 873.0, 973.0)


def verwey_birouk_mm2_s(gas_temperature_K: float) -> float:
    """Steady evaporation constant, 473 to 973 K."""
    return 3.6552e-4 * gas_temperature_K - 0.1078


# The validation data of the Fire Dynamics Simulator, cases kolaitis_heptane_1 and _2.
SUSPENDED = (
    Suspended(
        source="kolaitis_heptane_1",
        diameter_m=1.159e-3,
        temperature_K=322.15,
        gas_temperature_K=367.15,
        velocity_m_s=0.0,
        time_s=(5.0, 10.0, 15.0, 20.0),
        diameter2_mm2=(1.08, 0.83, 0.56, 0.33),
    ),
    Suspended(
        source="kolaitis_heptane_2",
        diameter_m=1.422e-3,
        temperature_K=288.65,
        gas_temperature_K=297.15,
        velocity_m_s=0.146,
        time_s=(20.0, 40.0, 60.0, 80.0),
        diameter2_mm2=(1.62, 1.23, 0.84, 0.47),
    ),
)
