"""Tests of what a camera gives."""
