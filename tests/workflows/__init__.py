"""Tests of studies, comparisons and experiments."""
