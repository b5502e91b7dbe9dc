"""Names and values for readers: `injected_mass_kg` becomes `injected mass`, 12.7 mg."""

from collections.abc import Mapping

from cldit.constants import ZERO_CELSIUS_K

# Ending of a key -> unit shown and factor. The longest that fits is the unit.
_UNITS: dict[str, tuple[str, float]] = {
    "_kg": ("mg", 1e6),
    "_m": ("mm", 1e3),
    "_s": ("ms", 1e3),
    "_K": ("K", 1.0),
    "_Pa": ("MPa", 1e-6),
    "_m_s": ("m/s", 1.0),
    "_m2_s": ("mm²/s", 1e6),
    "_kg_m3": ("kg/m³", 1.0),
    "_kg_s": ("g/s", 1e3),
    "_per_m": ("1/m", 1.0),
}

# Names that are clearer than their key.
_NAMES = {
    "coldest": "coldest gas",
    "wet bulb temperature": "wet-bulb temperature",
    "time": "time after start of injection",
}
# Quantity of a unit, for keys without it.
_QUANTITIES = {"K": "temperature", "MPa": "pressure"}
_EXTREMES = {"max": "largest ", "min": "smallest "}


def human(key: str, value: float) -> tuple[str, str]:
    """Name, and value with unit, of a quantity whose key ends with its SI unit.

    `human("jet_speed_m_s", 225.84)` is `("jet speed", "225.8 m/s")`. Lengths below 0.1 mm are in
    um; keys without a unit are counts or ratios. Integers are shown without decimals.
    """
    words = key.split("_")
    extreme = next((_EXTREMES[word] for word in words if word in _EXTREMES), "")
    key = "_".join(word for word in words if word not in _EXTREMES)  # x_K_max and x_max_K alike
    ending = max((end for end in _UNITS if key.endswith(end)), key=len, default="")
    unit, factor = _UNITS.get(ending, ("", 1.0))
    name = key.removesuffix(ending).replace("_", " ").replace("sauter", "Sauter")
    quantity = _QUANTITIES.get(unit, "")
    if quantity not in name and name not in _NAMES:
        name = f"{name} {quantity}"
    if unit == "mm" and 0.0 < abs(value) < 1e-4:
        unit, factor = "µm", 1e6
    shown = value * factor
    number = f"{shown:.0f}" if float(shown).is_integer() and abs(shown) < 1e15 else f"{shown:.4g}"
    if unit == "K" and quantity == "temperature":
        return extreme + _NAMES.get(name, name), f"{number} K ({value - ZERO_CELSIUS_K:.0f} °C)"
    return extreme + _NAMES.get(name, name), f"{number} {unit}".rstrip()


def human_figures(values: Mapping[str, float]) -> dict[str, str]:
    """Names and values of all quantities, in order; ValueError if two keys have one name."""
    rows = [human(key, value) for key, value in values.items()]
    names = [name for name, _ in rows]
    if len(set(names)) < len(names):
        raise ValueError(f"one name for two keys of {', '.join(values)}")
    return dict(rows)
