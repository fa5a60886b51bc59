"""Maps, and the walls, corridors, signs and viewpoints derived from them."""
