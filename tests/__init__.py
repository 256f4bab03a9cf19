"""Tests, arranged as the packages of `ballbot`."""
