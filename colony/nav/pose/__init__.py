"""Pose estimation: odometry, sonars, landmarks and the filter that fuses them."""
