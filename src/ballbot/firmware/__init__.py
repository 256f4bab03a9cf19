"""Firmware: the control law, the estimators and the safety layer as a C99 library with a controller's numbers.

The C sources are in `c/`, one file for each part with the name that it has in Python. `header` writes the structs and
the numbers from the schemas of the records (`ballbot.control.records`), `export` writes all files of a controller, and
`host` compiles the library for this computer and calls it, for tests and software in the loop. `emulator` runs it on an
emulated processor and counts instructions, from which `processor_load` reports what an update takes; `qemu` runs the
whole firmware on an emulated board (`board/`).
"""
