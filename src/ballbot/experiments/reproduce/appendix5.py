"""Appendix V, the ball's velocity from video: Figures V.1 and V.2, on a film of the twin upside down."""

from __future__ import annotations

import numpy as np

from ballbot.experiments.metrics import rms
from ballbot.experiments.reproduce.bench import Bench
from ballbot.experiments.reproduce.item import Check, Item

#: RMS difference of the two velocities over the peak that counts as a match
_MATCH = 0.05


def figure_v_1(bench: Bench) -> Item:
    """The seam that is seen and the curve that is fitted to it."""
    film = bench.film
    off, half_band = rms(film.distances), 0.5 * film.scene.seam_width
    tracked = float(film.spin.track.tracked.mean())
    return Item(
        name="Figure V.1",
        title="The seam that is seen, and the seam's curve fitted to it",
        thesis="The thesis shows the detected seam on the sphere with its curve fitted to it, for every "
        "frame.",
        ours=f"In {100.0 * tracked:.4g} % of {len(film.spin.t)} frames the curve is fitted; in the one "
        f"shown, {len(film.seen)} seam pixels are {1e3 * off:.0f} mrad from it (RMS), in a band that is "
        f"{1e3 * half_band:.0f} mrad to either side. The curve is (V.4) with both misprints mended (mistake "
        "10).",
        checks=(
            Check(
                claim="the curve is fitted to every frame",
                quantity="share of the frames",
                value=tracked,
                lowest=0.99,
            ),
            Check(
                claim="the curve lies on the seam",
                quantity="RMS distance of the seam's pixels, over half its width",
                value=off / half_band,
                highest=1.0,
            ),
        ),
    )


def figure_v_2(bench: Bench) -> Item:
    """The ball's velocity by video and by the wheels."""
    found = bench.film.comparison
    off = float(found.rms.max())
    gains = ", ".join(
        f"{gain:.3f} ± {half:.3f}" for gain, half in zip(found.gain, found.gain_half_width, strict=True)
    )
    return Item(
        name="Figure V.2",
        title="The ball's angular velocity by video, and T_obw times the wheels' speeds",
        thesis="Both match, so that the transformation from wheel speeds to ball velocity is right.",
        ours=f"They differ by at most {off:.3f} rad/s about any axis (RMS), where the ball turns by up to "
        f"{found.peak:.1f} rad/s; video over wheels is {gains} about x, y and z.",
        checks=(
            Check(
                claim="both match",
                quantity="largest RMS difference about an axis over the peak",
                value=off / found.peak,
                highest=_MATCH,
            ),
            Check(
                claim="the transformation is right",
                quantity="how far video over wheels is from 1, at most",
                value=float(np.abs(found.gain - 1.0).max()),
                highest=_MATCH,
            ),
        ),
    )
