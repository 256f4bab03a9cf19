"""Frames of a video file and their times."""

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.files import check_regular

#: containers round times to a millisecond; times within this of even steps are taken as even [s]
_ROUNDING = 1.1e-3
#: number of frames examined before tracking, and the time span that they are from [s]
_SAMPLES, _SAMPLED_TIME = 24, 4.0
#: fewer frames give no velocity
LEAST_FRAMES = 5


@dataclass(frozen=True, kw_only=True)
class Video:
    """A video file that opens and has frames."""

    path: Path
    size: tuple[int, int]  #: width and height [pixels]
    frame_rate: float  #: [Hz]
    rate_given: bool  #: whether the user gave this rate, so that times in the file are ignored
    stated_frames: int  #: stated in the file's header, for progress; 0 if it is not

    def frames(self) -> Iterator[tuple[float, NDArray[np.uint8]]]:
        """Yield the time by the file [s] and the picture (height, width, 3), blue green red, of each frame."""
        capture = cv2.VideoCapture(str(self.path))
        try:
            while True:
                whole, frame = capture.read()
                if not whole:
                    return
                yield capture.get(cv2.CAP_PROP_POS_MSEC) * 1e-3, np.asarray(frame, np.uint8)
        finally:
            capture.release()

    def samples(self) -> list[NDArray[np.uint8]]:
        """Return frames spread evenly over the first seconds; InputError if they are too few for a velocity."""
        wanted = max(LEAST_FRAMES, round(_SAMPLED_TIME * self.frame_rate))
        if self.stated_frames:
            wanted = min(wanted, max(LEAST_FRAMES, self.stated_frames))
        step = max(1, wanted // _SAMPLES)
        kept = [frame for _, frame in islice(self.frames(), 0, wanted, step)]
        if len(kept) * step < LEAST_FRAMES:
            raise InputError(
                f"{self.path} has too few readable frames; a velocity needs at least {LEAST_FRAMES}."
            )
        return kept


def open_video(path: str | Path, *, frame_rate: float | None = None) -> Video:
    """Open a video and read its header; `frame_rate` [Hz] replaces the file's, for example for slow motion.

    InputError if there is no such file, it is not a video, or the rate is not positive.
    """
    check_regular(path)
    # silence the messages of OpenCV and FFmpeg (silent at -8): the error below says it in one sentence
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        capture = cv2.VideoCapture(str(path))
        whole, frame = capture.read()
        rate, stated = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)
        capture.release()
    finally:
        cv2.utils.logging.setLogLevel(level)
    if not whole:
        raise InputError(f"{path} is not a video that OpenCV can read; use an MP4, AVI, MOV or WebM file.")
    rate = rate if frame_rate is None else frame_rate
    if not 0.0 < rate < math.inf:
        raise InputError(
            f"The frame rate of {path} is {rate:g}; give a positive one, in frames per second, with --frame-rate."
        )
    return Video(
        path=Path(path),
        size=(frame.shape[1], frame.shape[0]),
        frame_rate=float(rate),
        rate_given=frame_rate is not None,
        stated_frames=max(0, int(stated)),
    )


def frame_times(stated: Floats, video: Video) -> Floats:
    """Return the times (n,) of the frames [s] from those that the file states (n,) [s].

    Even steps at the frame rate if the rate is given or the file's times do not increase; even steps fitted to the
    file's times if these differ by a container's rounding only; otherwise the file's times.
    """
    k = np.arange(len(stated), dtype=np.float64)
    if video.rate_given or len(stated) < 2 or not np.all(np.diff(stated) > 0.0):
        return k / video.frame_rate
    slope, start = np.polyfit(k, stated, 1)
    even = start + slope * k
    return even - even[0] if np.abs(stated - even).max() < _ROUNDING else stated - stated[0]
