"""Maps and what is derived from them: walls, corridors, signs and places to stand."""
