"""Pictures of maps, plans, paths and networks."""
