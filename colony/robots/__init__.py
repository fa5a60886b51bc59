"""Complete robots, simulated or real, assembled from all packages to run a program."""
