"""Seconds of the coverage-guided fuzzer, whose hour is a campaign."""

import numpy as np
import pytest

from ballbot.control.records import schema_of
from ballbot.firmware.records import STATE, RunState
from campaigns.firmware_fuzz import fuzz, is_available, real_words


def test_real_words_of_the_state_are_its_real_numbers():
    words = real_words()
    assert len(set(words)) == len(words)
    assert max(words) < STATE.dtype("single").itemsize // 4
    record = np.zeros(1, STATE.dtype("single"))
    record.view(np.float32)[words] = 1.5
    run = record["run"][0]
    for name, one in schema_of(RunState).fields.items():
        assert (run[name] == (0 if one.whole else 1.5)).all()


@pytest.mark.sample
def test_no_input_of_twenty_seconds_breaks_the_firmware(tmp_path):
    if not is_available():
        pytest.skip("clang with libFuzzer is missing")
    done = fuzz(tmp_path, seconds=20)
    # 20 s gave 75,000 inputs and 911 edges beside three other jobs; they must at least reach the law and the link
    assert done.branches > 500
