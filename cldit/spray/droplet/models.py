"""Evaporation models: functions of kernels/spray/evaporation.h; a new one is one function there."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Model:
    """Evaporation model.

    function: its name in kernels/spray/evaporation.h, or in `source`. source: OpenCL C of a
    function that the header does not have; it begins with `#include "spray/evaporation.h"`.
    """

    function: str
    source: str = ""


inert = Model("inert")  # neither evaporates nor warms

MODELS: dict[str, Model] = {
    "abramzon-sirignano": Model("abramzon_sirignano"),
    "spalding": Model("spalding"),
    "dukowicz": Model("dukowicz"),
    "dukowicz-log": Model("dukowicz_logarithmic"),
    "frolov-type": Model("frolov_type"),
}
