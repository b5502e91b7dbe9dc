"""Images -> emissivity and apparent temperature."""
