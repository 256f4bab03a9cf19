"""What tests share: examples with a known truth, independent oracles, and paths."""
