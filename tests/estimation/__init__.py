"""Tests of the on-board state."""
