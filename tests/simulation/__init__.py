"""Tests of plants, sensors and closed loops."""
