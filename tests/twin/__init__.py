"""Tests of the MuJoCo twin."""
