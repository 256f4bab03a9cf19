"""Timings against peers (`make bench`) and long campaigns (`make evidence`)."""
