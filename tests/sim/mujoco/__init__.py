"""Tests of the robot that MuJoCo moves."""
