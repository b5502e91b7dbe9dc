"""Thresholds for pixels that have an apparent temperature."""

VISIBLE_EMISSIVITY = 0.05  # below it a temperature has little meaning
VISIBLE_DISC = 0.5  # least weight of the background in a pixel without spray
