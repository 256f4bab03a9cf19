"""Where the project's files are."""

from pathlib import Path

#: the folder of the whole project
ROOT = Path(__file__).parents[2]
