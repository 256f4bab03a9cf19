"""The thesis reproduced: its figures and tables from the twin and the models, beside what the thesis shows.

item.py         the result for one figure or table: `Item`, and the numbers that decide its verdict, `ClaimCheck`
figures.py      each figure and table: what is measured, what the thesis shows, and the drawing
mistakes.py     the thesis's misprints and mistakes, each with the number that shows it
recordings.py   recordings of the twin
runs.py         how runs are measured and compared with the models
bench.py        what several figures share: recordings, the friction identified from them, runs of the models
campaign.py     the command's work: all items in the thesis's order
page.py         the page
"""

from ballbot.thesis.reproduce.campaign import Reproduction, reproduce
from ballbot.thesis.reproduce.item import VERDICTS, ClaimCheck, Item, Mistake, Verdict

__all__ = ["VERDICTS", "ClaimCheck", "Item", "Mistake", "Reproduction", "Verdict", "reproduce"]
