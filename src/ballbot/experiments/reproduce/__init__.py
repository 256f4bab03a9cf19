"""The thesis remade: every figure and table from the twin and the models, beside what the thesis shows.

item.py       what is said of one figure or table: `Item`, and the numbers it is judged by, `Check`
registry.py   all of them in the thesis's order; Figure 5.6 is `chapter5.figure_5_6`
chapter*.py, appendix*.py   one file a chapter: what is measured and what the thesis says of it
mistakes/     the thesis's misprints and mistakes, each with the number that shows it
recordings.py what is recorded on the twin, kept in a folder so that a run that was stopped goes on
bench.py      what several figures share: recordings, the friction identified from them, runs on the models
campaign.py   the command's work: record, identify, judge

The drawings are in `ballbot.report.reproduce`, in files of the same names.
"""

from ballbot.experiments.reproduce.campaign import Reproduction, reproduce
from ballbot.experiments.reproduce.item import VERDICTS, Check, Item, Mistake, Verdict

__all__ = ["VERDICTS", "Check", "Item", "Mistake", "Reproduction", "Verdict", "reproduce"]
