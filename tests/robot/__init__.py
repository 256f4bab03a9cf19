"""Tests of robots as values."""
