"""The link on the processor: within the time of a sample, and within the stack that the example of a task asks for."""

import importlib.util

import pytest

from campaigns.link_timing import measure

pytestmark = [
    pytest.mark.sample,
    pytest.mark.skipif(
        not (importlib.util.find_spec("ziglang") and importlib.util.find_spec("unicorn")),
        reason="ziglang or unicorn is missing",
    ),
]


def test_link_takes_little_of_a_sample_on_the_processor():
    found, link = measure()
    assert {name for name, *_ in found} >= {"take `Keep`", "take `Write`", "send `State`"}
    for name, _, cycles, _ in found:
        assert cycles < 0.1 * 72e6 * 0.005, name  # a tenth of 5 ms
    # what `ballbot export` reports for an update, and the 512 bytes more that examples/rtos_task.c names
    bound = link.image.stack_bound("ballbot_update") + 512
    assert link.image.stack_bound("ballbot_link_receive") < bound
    assert link.image.stack_bound("ballbot_link_update") < bound
