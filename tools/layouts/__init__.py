"""The layouts of a robot, held to each other frame by frame over drawn programs and faults."""
