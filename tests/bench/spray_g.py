"""The conditions of the Engine Combustion Network's Spray G: a section of the verification."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.scene.sizes import Monodisperse, NukiyamaTanasawa
from cldit.scene.spray import EIGHT_PLUMES, FlowBox
from cldit.show.page import Bullets, Section, Table
from cldit.spray.droplet.fluids import fuel_table, gas_table
from tests.bench.spray_history import Bench
from tests.unit.spray.flow.references import SPRAY_G, Found, saturation

_TIMES = (0.2, 0.4, 0.6, 0.8)  # ms
_AXIS_TIMES = (0.6, 0.8, 0.9, 1.0, 1.1)
_SOURCES = (
    "[1] As a public case of another code quotes the ECN: the summary of its third workshop, and "
    "its file of gas velocities at z = 15 mm. The proceedings themselves were not read. No "
    "measured penetration of the vapour, and no speed of droplets, could be read."
)
_CAUSES = (
    "**Liquid with cones of 22°**, 36 mm: the cone of a plume is input. Siebers' length goes as "
    "1/tan of half of it; 30° is the cone that the source above gives for this injector.",
    "**D32**, 8.7 µm: it is input, too, 9 µm at the hole. With 11 µm it is 10.8 µm.",
    "**Gas on the axis at 1.0 ms**: the small difference of two large flows, of what the plumes "
    "draw in and what they drag along. On gas of 2 mm it is +8 m/s; there, with a mixing length of "
    "0.013 or 0.025 (0.018) -3 and +50, with an injection of 0.68 ms +21, with plumes at 37° +10. "
    "Inputs and grid are not known well enough for a comparison.",
)


def _changes(box: FlowBox) -> dict[str, dict[str, Any]]:
    wide = box.model_copy(update={"depth_m": 80e-3})
    return {
        "abramzon-sirignano": {},
        "the same, 80 mm deep": {"box": wide},
        "the same, another seed": {"seed": 2},
        "the same, cones of 22°": {"plumes": EIGHT_PLUMES},
        "the same, 11 µm": {"droplets": NukiyamaTanasawa(m_um=1.5 * 11 / 9)},
        "the same, all of 9 µm": {"droplets": Monodisperse(diameter_um=9.0)},
        "dukowicz-log": {"evaporation": "dukowicz-log"},
        "dukowicz": {"evaporation": "dukowicz"},
    }


def spray_g(bench: Bench) -> Section:
    """Section of the page: this injector, and what its liquid depends on."""
    spec = SPRAY_G.model_copy(update={"box": bench.box()})
    changes = _changes(spec.box)
    found = [
        bench.run(f"Spray G, {label}", spec.model_copy(update=change))
        for label, change in changes.items()
    ]
    fuel = fuel_table("iso-octane", cache=bench.cache)
    gas = gas_table("nitrogen", cache=bench.cache)
    t_sat, _ = saturation(fuel, gas, fuel_K=363.0, gas_K=573.0, pressure_Pa=0.6e6)
    theirs = 1e3 * found[0].jet.tip_m(1e-3)

    def when(each: Found, column: str, times: Sequence[float]) -> Floats:
        history = each.history
        reach: Floats = getattr(history, column)
        return np.asarray(np.interp(np.multiply(1e-3, times), history.time_s, reach))

    def liquid(each: Found, column: str) -> str:
        reach = ", ".join(f"{1e3 * value:.0f}" for value in when(each, column, _TIMES))
        return f"{reach}; {1e3 * getattr(each.history, column).max():.1f} mm"

    def axis(each: Found) -> str:
        return ", ".join(f"{value:+.0f}" for value in when(each, "axis_m_s", _AXIS_TIMES))

    kinds: list[tuple[str, Callable[[Found], str], str]] = [
        (
            "liquid, axial, to 2e-3 mm³/mm²: 0.2, 0.4, 0.6, 0.8 ms; largest",
            lambda each: liquid(each, "liquid_m"),
            "largest 30 ± 5 [1]",
        ),
        (
            "the same to 0.2e-3 mm³/mm²",
            lambda each: liquid(each, "thin_liquid_m"),
            "no published figure",
        ),
        (
            "vapour, along the plumes, 1.0 ms",
            lambda each: f"{1e3 * when(each, 'vapour_m', [1.0])[0]:.1f} mm",
            f"{theirs:.1f} (Naber-Siebers, one plume alone with cones of 30°)",
        ),
        (
            "D32 of what passed z = 15 mm",
            lambda each: f"{1e6 * each.spray.notes['sauter_mean_diameter_at_15_mm_m']:.1f} µm",
            "10 to 12 [1]",
        ),
        (
            "gas on the axis at 15 mm, away from the injector, 0.6, 0.8, 0.9, 1.0, 1.1 ms",
            lambda each: f"{axis(each)} m/s",
            "+1.4 at 1.0 ms [1]; before: no published figure",
        ),
        (
            "coldest gas",
            lambda each: f"{each.history.coldest_K.min():.0f} K",
            f"{t_sat:.0f} K (saturation)",
        ),
    ]
    rows = [[label, *(text(each) for each in found), wanted] for label, text, wanted in kinds]
    return Section(
        "Conditions of the ECN's Spray G",
        [
            "Iso-octane of 363 K, 20 MPa, 10 mg in 0.78 ms into nitrogen of 573 K and 0.6 MPa; "
            "plumes at 33° with cones of 30°, as Colmenares, Ameen and Patel describe this "
            "injector (J. Eng. Gas Turbines Power 145, 061009), 9 µm, up to 1.2 ms. A scene has "
            "the first of the evaporation models, and cones of 22°, unless it says otherwise.",
            Table(["", *changes, "expected"], rows),
            _SOURCES,
            "What differs from these figures, and why:",
            Bullets(_CAUSES),
        ],
    )
