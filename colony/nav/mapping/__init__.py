"""Local maps from sonar readings, the lines in them, and the matching of these lines to walls."""
