"""The thesis remade, drawn and written: one file a chapter, as in `ballbot.experiments.reproduce`."""
