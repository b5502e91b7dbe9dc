"""Which pixels count where the error of an apparent temperature is told."""

from __future__ import annotations

VISIBLE_EMISSIVITY = 0.05  # below it a temperature says little, whatever the trace
