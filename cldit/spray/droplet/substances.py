"""Property columns of fuels and carrier gases: from CoolProp, except for iso-octane.

Gases are ideal and dilute; properties of a liquid are those at saturation. CoolProp is imported
only here, when a table is built, since this takes seconds.
"""

from __future__ import annotations

import difflib
import re
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.constants import STANDARD_ATMOSPHERE_Pa
from cldit.errors import SprayError
from cldit.io.tables import Arrays
from cldit.spray.droplet.curves import integral

# Fuller, Ensley and Giddings, J. Phys. Chem. 73, 3679 (1969): diffusion volumes, cm3/mol.
_GAS_VOLUMES = {
    "nitrogen": 18.5,
    "air": 19.7,
    "oxygen": 16.3,
    "argon": 16.2,
    "carbon dioxide": 26.9,
    "helium": 2.67,
}
_ATOMS = {"C": 15.9, "H": 2.31, "O": 6.11}
_WHOLE = {"Water": 13.1}  # of the whole molecule
# Increment of an aromatic ring, of which these fuels have one.
_RINGS = dict.fromkeys(
    ("benzene", "toluene", "ethylbenzene", "m-xylene", "o-xylene", "p-xylene"), -18.3
)

GASES = tuple(_GAS_VOLUMES)

_LIQUID_POINTS = 801  # cubic between them; 0.4 K apart for n-heptane, 183 to 529 K
_VAPOUR_POINTS = 1201  # 0.9 K apart from 183 to 1200 K
_COLDEST_K = {"helium": 101.0}  # CoolProp's viscosity jumps by 1 % at 100 K; other gases: 80 K
_HOTTEST_K = 1200.0  # beyond, the transport fits of heavy fuels decrease
_BELOW_CRITICAL = 0.98  # of the critical temperature: cp diverges and latent heat vanishes there


def fuel_columns(name: str) -> Arrays:
    """Columns of a fuel: iso-octane, or a fluid of CoolProp that consists of C, H and O.

    They are properties on two uniform temperature grids, `liquid_K.` (M,) and `vapour_K.` (K,):
    `liquid.` ln_psat (Pa), density, cp, latent, conductivity, viscosity, tension, enthalpy, none of
    a carrier gas; `vapour.` cp, conductivity, viscosity, enthalpy, which is that of the liquid plus
    the latent heat at the normal boiling point, or of a carrier zero at the lowest temperature; and
    the numbers `constants.` molar_mass_kg_mol, diffusion_volume, critical_K, critical_Pa.

    Raises SprayError if there is no such fluid, or if CoolProp lacks its transport properties.
    """
    if re.sub(r"[-_ ]", "", name.casefold()) in _ISO_OCTANE_NAMES:
        return _iso_octane()
    fluid = _coolprop_name(name)
    state = _state(fluid)
    formula = re.findall(r"([A-Z][a-z]?)_\{(\d+)\}", state.fluid_param_string("formula"))
    if not formula or any(atom not in _ATOMS for atom, _ in formula):
        raise SprayError(
            f"fuel {name!r}: the diffusivity model is for molecules of C, H and O only"
        )
    ring = _RINGS.get(fluid.casefold(), 0.0)
    low = float(np.ceil(state.Ttriple()))
    liquid_K = np.linspace(low, _BELOW_CRITICAL * state.T_critical(), _LIQUID_POINTS)
    rows = np.array([_saturated(state, t) for t in liquid_K])
    liquid = dict(zip(_SATURATED, rows.T, strict=True))
    constants = {
        "molar_mass_kg_mol": state.molar_mass(),
        "diffusion_volume": _WHOLE.get(fluid, ring + sum(_ATOMS[a] * int(n) for a, n in formula)),
        "critical_K": state.T_critical(),
        "critical_Pa": state.p_critical(),
    }
    return _finished(constants, liquid_K, liquid, *_dilute(state, low))


def gas_columns(name: str) -> Arrays:
    """Columns of a carrier gas; raises SprayError if it is not one of `GASES`."""
    key = name.casefold().replace("-", " ")
    if key not in GASES:
        raise SprayError(f"gas {name!r}; allowed: {', '.join(GASES)}")
    state = _state(key.title().replace(" ", ""))
    constants = {
        "molar_mass_kg_mol": state.molar_mass(),
        "diffusion_volume": _GAS_VOLUMES[key],
        "critical_K": state.T_critical(),
        "critical_Pa": state.p_critical(),
    }
    vapour_K, vapour = _dilute(
        state, max(_COLDEST_K.get(key, 80.0), float(np.ceil(state.Ttriple())))
    )
    vapour["enthalpy"] = integral(vapour_K, vapour["cp"])
    return _arrays(constants, np.empty(0), {}, vapour_K, vapour)


_SATURATED = ("ln_psat", "density", "cp", "latent", "conductivity", "viscosity", "tension")


def _state(fluid: str) -> Any:
    import CoolProp.CoolProp as coolprop

    return coolprop.AbstractState("HEOS", fluid)


def _coolprop_name(name: str) -> str:
    import CoolProp.CoolProp as coolprop

    key = name.casefold()
    fluids = {"iso-octane": ""}  # only for the hint
    for fluid in coolprop.get_global_param_string("FluidsList").split(","):
        aliases = coolprop.get_fluid_param_string(fluid, "aliases").split(",")
        fluids |= {alias.strip().casefold(): fluid for alias in [fluid, *aliases] if alias}
    if key not in fluids:
        close = difflib.get_close_matches(key, fluids, n=4)
        hint = f"did you mean {' or '.join(close)}?" if close else "see the fluids of CoolProp"
        raise SprayError(f"fuel {name!r}: neither iso-octane nor a fluid of CoolProp; {hint}")
    return fluids[key]


def _saturated(state: Any, temperature_K: float) -> tuple[float, ...]:
    import CoolProp.CoolProp as coolprop

    state.update(coolprop.QT_INPUTS, 1.0, temperature_K)
    vapour_enthalpy = state.hmass()
    state.update(coolprop.QT_INPUTS, 0.0, temperature_K)
    try:
        transport = state.conductivity(), state.viscosity(), state.surface_tension()
    except ValueError as error:
        raise SprayError(
            f"fuel {state.name()}: CoolProp lacks its transport properties ({error})"
        ) from error
    latent = vapour_enthalpy - state.hmass()
    return (np.log(state.p()), state.rhomass(), state.cpmass(), latent, *transport)


def _dilute(state: Any, low_K: float) -> tuple[Floats, dict[str, Floats]]:
    import CoolProp.CoolProp as coolprop

    grid = np.linspace(low_K, _HOTTEST_K, _VAPOUR_POINTS)
    rows = []
    for t in grid:
        state.update(coolprop.DmassT_INPUTS, 1e-6, t)  # dilute enough to be ideal
        rows.append((state.cp0mass(), state.conductivity(), state.viscosity()))
    return grid, dict(zip(("cp", "conductivity", "viscosity"), np.array(rows).T, strict=True))


def _finished(
    constants: dict[str, float],
    liquid_K: Floats,
    liquid: dict[str, Floats],
    vapour_K: Floats,
    vapour: dict[str, Floats],
) -> Arrays:
    """Adds the enthalpies, with one zero."""
    heat = integral(liquid_K, liquid["cp"])
    boiling = float(np.interp(np.log(STANDARD_ATMOSPHERE_Pa), liquid["ln_psat"], liquid_K))
    liquid["enthalpy"] = heat - np.interp(boiling, liquid_K, heat)
    rise = integral(vapour_K, vapour["cp"])
    start = np.interp(boiling, liquid_K, liquid["latent"])
    vapour["enthalpy"] = start + rise - np.interp(boiling, vapour_K, rise)
    return _arrays(constants, liquid_K, liquid, vapour_K, vapour)


def _arrays(
    constants: dict[str, float],
    liquid_K: Floats,
    liquid: dict[str, Floats],
    vapour_K: Floats,
    vapour: dict[str, Floats],
) -> Arrays:
    """Columns by name, as `fuel_columns`."""
    arrays: Arrays = {"liquid_K.": liquid_K, "vapour_K.": vapour_K}
    arrays |= {f"constants.{name}": np.asarray(value) for name, value in constants.items()}
    arrays |= {f"liquid.{name}": column for name, column in liquid.items()}
    return arrays | {f"vapour.{name}": column for name, column in vapour.items()}


_ISO_OCTANE_NAMES = ("isooctane", "ic8h18", "2,2,4trimethylpentane")


def _iso_octane() -> Arrays:
    """Fits of NSRDS/DIPPR (Daubert and Danner), coefficients as tabulated by OpenFOAM (IC8H18)."""
    critical = 543.96
    low = 166.0
    liquid_K = np.linspace(low, _BELOW_CRITICAL * critical, _LIQUID_POINTS)
    t, r = liquid_K, liquid_K / critical
    liquid = {
        "ln_psat": 120.81 - 7550 / t - 16.111 * np.log(t) + 0.017099 * t,
        "density": 67.2363666 / 0.27373 ** (1 + (1 - r) ** 0.2846),
        "cp": 1219.89652546156 + 1.67205049417409 * t + 0.00414073237562483 * t * t,
        "latent": 375379.713037617 * (1 - r) ** (0.1549 + r * (0.138 + r * 0.0666)),
        "conductivity": 0.1508 - 0.0001712 * t,
        "viscosity": np.exp(-15.811 + 1282.5 / t + 0.67791 * np.log(t) - 3.8617e-28 * t**10),
        "tension": 0.047434 * (1 - r) ** 1.1975,
    }
    vapour_K = np.linspace(low, _HOTTEST_K, _VAPOUR_POINTS)
    t = vapour_K
    vapour = {
        "cp": 997.10236275617
        + 4627.4653990598 * _einstein(1594.0 / t, np.sinh)
        + 2933.52942721328 * _einstein(677.94 / t, np.cosh),
        "conductivity": 1.758e-5 * t**1.3114 / (1 + 392.9 / t),
        "viscosity": 1.107e-7 * t**0.746 / (1 + 72.4 / t),
    }
    constants = {
        "molar_mass_kg_mol": 0.114231,
        "diffusion_volume": 8 * _ATOMS["C"] + 18 * _ATOMS["H"],
        "critical_K": critical,
        "critical_Pa": 2.5676e6,
    }
    return _finished(constants, liquid_K, liquid, vapour_K, vapour)


def _einstein(ratio: Floats, function: Any) -> Floats:
    return np.asarray((ratio / function(ratio)) ** 2)
