"""The league: every controller on the same courses with the same seeds, and what the differences are worth."""
