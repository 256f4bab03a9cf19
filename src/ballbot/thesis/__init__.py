"""The thesis: its figures and tables reproduced, and its misprints and mistakes, each with the number that shows it.

Nothing else in Ballbot imports this package; the command `ballbot reproduce` calls it.
"""
