"""The study of the door plate finders."""
