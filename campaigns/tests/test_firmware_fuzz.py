"""Seconds of the coverage-guided fuzzer, whose hour is a campaign."""

import pytest

from campaigns.firmware_fuzz import fuzz, is_available


@pytest.mark.sample
def test_no_input_of_twenty_seconds_breaks_the_firmware(tmp_path):
    if not is_available():
        pytest.skip("clang with libFuzzer is missing")
    done = fuzz(tmp_path, seconds=20)
    # 20 s gave 75,000 inputs and 911 edges beside three other jobs; they must at least reach the law and the link
    assert done.branches > 500
