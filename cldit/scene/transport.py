"""Settings of the radiative transfer: method, accuracy and phase function."""

from typing import Annotated, Any, Literal, get_args

from pydantic import BeforeValidator, Discriminator, Tag, model_validator

from cldit.scene.checks import Section, Within


def _asymmetry(value: object) -> object:
    """The number of `{henyey_greenstein: g}`, as older versions had it."""
    section = isinstance(value, dict) and set(value) == {"henyey_greenstein"}
    return value["henyey_greenstein"] if section and isinstance(value, dict) else value


def _kind(value: object) -> str | None:
    """Tag of the type in `Phase` that checks a value; None: the value is no phase function."""
    if value in _NAMES:
        return "[name]"
    return "[number]" if isinstance(value, (int, float)) and value is not True else None


PhaseName = Literal["isotropic", "mie"]
_NAMES = get_args(PhaseName)
Phase = Annotated[
    Annotated[PhaseName, Tag("[name]")] | Annotated[float, Within(-0.999, 0.999), Tag("[number]")],
    Discriminator(
        _kind,
        custom_error_type="not_allowed",
        custom_error_message=f"allowed: {', '.join(_NAMES)}, or the g of Henyey and Greenstein",
    ),
    BeforeValidator(_asymmetry),
]


class Transport(Section):
    """Settings of the radiative transfer."""

    method: Literal["source", "path", "branching"] = "source"
    """`source`: discrete ordinates and final gather, fast; `path`: unbiased Monte Carlo path
    tracing; `branching`: as in the paper."""
    order: Annotated[int, Within(0, 1000)] | None = None
    """Largest number of scatterings; beyond it the walls are seen. Default: no limit."""
    accuracy_K: Annotated[float, Within(1e-4, 100.0)] = 1.0
    """Tolerance for the error of T_app: RMS over the pixels with a T_app, all error sources of the
    simulation combined. With `audit: false`, the error of the trace alone."""
    accuracy_emissivity: Annotated[float, Within(1e-6, 1.0)] | None = None
    """Likewise for emissivity; `accuracy: {temperature_K: 1, emissivity: 0.01}` sets both. Default:
    the error that changes T_app of an opaque medium by `accuracy_K`, to first order."""
    max_samples: Annotated[int, Within(128, 10_000_000)] = 4096
    """Largest number of samples per pixel, of `path` and of the final gather."""
    phase: Phase | None = None
    """Phase function of the droplets, or the g of Henyey and Greenstein. Default: isotropic with
    `optics.preset: paper`; mie with `spectral`, but isotropic for coefficients and `branching`."""
    gather: bool = True
    """Method `source`: resolve the radiance within optically thick cells by a final gather."""
    audit: bool = True
    """Estimate the error by source, and choose the settings that are not given."""
    cutoff: Annotated[float, Within(0.0, 0.5)] | None = None
    """Transmission at which a ray ends. Default: light beyond it is 1 % of `accuracy_K` at most."""
    directions: Annotated[int, Within(4, 4096)] | None = None
    """Number of discrete ordinates. Default: chosen from `accuracy_K`."""
    precision: Literal["auto", "float32", "float64"] = "auto"
    """Floating-point precision; `auto`: float32 where it suffices, otherwise float64."""
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1
    """Random seed of methods `path` and `branching`."""

    @model_validator(mode="before")
    @classmethod
    def _of_both(cls, data: Any) -> Any:
        """Takes `accuracy: {temperature_K: 1, emissivity: 0.01}` for both tolerances."""
        if not isinstance(data, dict) or not isinstance(data.get("accuracy"), dict):
            return data
        keys = {"temperature_K": "accuracy_K", "emissivity": "accuracy_emissivity"}
        rest = {key: value for key, value in data.items() if key != "accuracy"}
        tolerances = {
            keys.get(key, f"accuracy.{key}"): value for key, value in data["accuracy"].items()
        }
        if twice := sorted(set(rest) & set(tolerances)):
            raise ValueError(f"{twice[0]} and accuracy: allowed: one of them")
        return rest | tolerances
