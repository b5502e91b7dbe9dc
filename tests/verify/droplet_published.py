"""Evaporation of single n-heptane droplets: a few points of each measurement, as printed, and
figures of another program."""

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

# Computed by another program with the NSRDS fits of n-heptane: wet bulb, K, and steady K, mm2/s.
# The fits and CoolProp differ by up to 1 % in psat, which is 0.3 K, and L, which is 1 % of K.
WET_BULB = [
    (0.15e6, 300.0, (288.7, 0.009), (280.0, 0.015), 0.015),
    (0.15e6, 573.0, (343.0, 0.154), (330.8, 0.291), 0.218),
    (0.15e6, 620.0, (345.7, 0.178), (334.6, 0.363), 0.261),
    (0.30e6, 500.0, (355.9, 0.114), (340.2, 0.188), 0.153),
    (0.60e6, 573.0, (386.0, 0.162), (369.3, 0.292), 0.223),
    (0.90e6, 300.0, (297.3, 0.002), (293.3, 0.005), 0.005),
    (0.90e6, 620.0, (406.0, 0.198), (389.0, 0.380), 0.279),
]

# Life and half of the mass, us, of 9 um at 370 K, at rest, computed by another program with the
# NSRDS fits: A-S, Dukowicz, Dukowicz with ln(1 + B)/B, finite conductivity. Vapour pressures that
# differ by 1 % shift these by as much.
LIVES = [
    (0.15e6, 300.0, (6792, 3552, 3682, 6901), (1270, 484, 529, 1380)),
    (0.15e6, 400.0, (1129, 693, 803, 1140), (290, 134, 173, 301)),
    (0.15e6, 573.0, (470, 225, 312, 473), (147, 56, 87, 151)),
    (0.15e6, 620.0, (413, 183, 265, 415), (133, 48, 77, 135)),
    (0.60e6, 400.0, (1683, 1005, 1112, 1684), (567, 288, 328, 568)),
    (0.60e6, 573.0, (534, 276, 361, 534), (213, 102, 133, 212)),
    (0.90e6, 300.0, (30819, 11752, 11880, 30945), (9681, 3079, 3126, 9807)),
    (0.90e6, 620.0, (473, 237, 316, 473), (204, 99, 129, 203)),
]
