#!/bin/sh
# start.sh - all processes of the example, one a line; Ctrl-C ends them. Run it from the folder above `examples`.
trap 'trap - TERM; kill 0' INT TERM EXIT

# The building, and what each robot has of its own.
python examples/two_robots/building.py --map examples/two_robots/narrow.stickrep --robot ada=2500,1000,270 --robot ben=9000,3000,90 &
colony serve Clock --robot ada &
colony serve RServer --robot ada &
colony serve PServer --robot ada &
colony serve DServer --robot ada &
colony serve Clock --robot ben &
colony serve RServer --robot ben &
colony serve PServer --robot ben &
colony serve DServer --robot ben &

# What they share.
colony serve DServer --robot fleet &

# The programs.
python examples/two_robots/keeper.py --robot ada &
python examples/two_robots/keeper.py --robot ben &
colony drive examples/two_robots/passage.colony --robot ada &
colony drive examples/two_robots/passage.colony --robot ben &
wait
