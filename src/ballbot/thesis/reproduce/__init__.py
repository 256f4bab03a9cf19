"""The thesis remade: every figure and table from the twin and the models, beside what the thesis shows.

item.py       what is said of one figure or table: `Item`, and the numbers it is judged by, `Check`
chapter*.py   one file a chapter: what is measured and what the thesis says of it; Figure 5.6 is `chapter5.figure_5_6`
appendices.py the same for the appendices
mistakes/     the thesis's misprints and mistakes, each with the number that shows it
recordings.py what is recorded on the twin, kept in a folder so that an interrupted run can be resumed
runs.py       how runs are measured and compared with the models
bench.py      what several figures share: recordings, the friction identified from them, runs on the models
campaign.py   the command's work: record, identify, compare; all items in the thesis's order
figures.py, figures_5.py, drawing.py, page.py   the drawings, and the page
"""

from ballbot.thesis.reproduce.campaign import Reproduction, reproduce
from ballbot.thesis.reproduce.item import VERDICTS, Check, Item, Mistake, Verdict

__all__ = ["VERDICTS", "Check", "Item", "Mistake", "Reproduction", "Verdict", "reproduce"]
