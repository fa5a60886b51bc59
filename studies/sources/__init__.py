"""The study of the sources of the pose estimate."""
