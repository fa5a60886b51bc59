"""Door plates: their detection, tracking over images, and reading."""
