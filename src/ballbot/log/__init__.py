"""The one time-series type that every experiment is, and reading and writing its file formats."""

from ballbot.findings import Finding
from ballbot.log.collection import LogLike, LogsLike, as_log, as_logs
from ballbot.log.columns import STATE_NAMES
from ballbot.log.log import Log
from ballbot.log.mapping import LogMapping

__all__ = ["STATE_NAMES", "Finding", "Log", "LogLike", "LogMapping", "LogsLike", "as_log", "as_logs"]
