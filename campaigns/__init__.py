"""Long campaigns (`make evidence`), of which the tests run samples; the page is docs/generated/evidence.md."""
