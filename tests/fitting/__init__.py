"""Tests of estimation as such."""
