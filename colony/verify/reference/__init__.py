"""The reference interpreter, which defines what programs mean."""
