"""Tests of logs, their formats, checks and mappings."""
