"""iRobot Create 2 and Roomba 600: the Open Interface."""
