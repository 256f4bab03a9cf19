"""Tests of equations of motion, friction and the stick-slip step."""
