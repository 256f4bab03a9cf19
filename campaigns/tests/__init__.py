"""Tests of samples of the campaigns of `make evidence`."""
