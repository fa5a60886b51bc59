"""Local maps from sonar readings, the lines in them, and the match of these lines to walls."""
