"""Long campaigns (`make evidence`): what the tests sample, at length; the page is docs/generated/evidence.md."""
