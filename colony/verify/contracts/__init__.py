"""Whether contracts hold in every frame that there can be: proved, refuted by a trace, or unknown and why."""
