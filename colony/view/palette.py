"""The colors of all pictures."""

INK, MUTED, FAINT, PAPER, FLOOR = "#2b2f36", "#7a8290", "#d3d7de", "#eceef1", "#ffffff"
SERIES = ("#1769d6", "#0f9d76", "#c2335f", "#5d6b00", "#8a3fb8", "#00879e")
"""Colors of things of one kind: paths, enumerators."""
GOOD, BAD = SERIES[0], SERIES[2]
