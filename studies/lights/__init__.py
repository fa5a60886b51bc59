"""The study of the detection of ceiling lights."""
