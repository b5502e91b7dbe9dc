"""Which pixels have an apparent temperature, and count where its error is told."""

from __future__ import annotations

VISIBLE_EMISSIVITY = 0.05  # below it a temperature says little, whatever the trace
VISIBLE_DISC = 0.5  # share of the disc's radiance that a pixel must see without spray
