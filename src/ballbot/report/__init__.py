"""What people and programs read of a result: report.html, results.json, and the words and figures in them."""
