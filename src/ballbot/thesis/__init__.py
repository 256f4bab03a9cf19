"""The thesis: its figures and tables reproduced, its mistakes, published models, and the Lagrangian in symbols.

reproduce/      the figures and tables from the twin and the models, compared with the thesis,
                and
its misprints and mistakes, each with the number that shows it
published/      other ball-balancing robots: what their sources print, and what our equations give
lagrangian.py   Appendix II derived by SymPy; the compiled equations are tested against it

Nothing else in Ballbot imports this package; the command `ballbot reproduce` calls it.
"""
