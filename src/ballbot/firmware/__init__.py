"""Firmware: the control law, the estimators and the safety layer as a C99 library with a controller's numbers.

The C sources are in `c/`, one file for each part with the name that it has in Python. `header` writes the structs and
the numbers from the schemas of the records (`ballbot.records`), and `export` writes all files of a controller.
`emulator` runs it on an emulated processor and counts instructions, from which `processor_load` reports what an update
takes.
"""
