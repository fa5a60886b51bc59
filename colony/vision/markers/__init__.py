"""The markers on elevator doors: their detection, and the pose that follows from them."""
