"""The simulated hardware: devices and the process that serves them to drivers."""
