"""Timings against peers (`make bench`); docs/generated/benchmarks.md is made from them."""
