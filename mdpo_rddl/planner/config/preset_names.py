"""The presets' names, for those who offer them and import no JAX."""

DEFAULT_PRESET = "auto"
PLAIN_PRESET = "paper"
"""What options for one training with one policy start from."""

PRESET_NAMES = (DEFAULT_PRESET, PLAIN_PRESET)
