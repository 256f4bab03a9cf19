"""What a controller takes on its processor: the rehearsal sees every branch, and has the bits of this computer."""

from functools import cache

import pytest

pytest.importorskip("ziglang", reason="ziglang, of the extra `test`, is not installed")
pytest.importorskip("unicorn", reason="unicorn, of the extra `test`, is not installed")

from ballbot import Controller, InputError
from ballbot.firmware.build import source_files
from ballbot.firmware.emulator import CLOCK, CYCLES, Board, compile_image
from ballbot.firmware.export import PROJECT, export_controller
from ballbot.firmware.header import SOURCES
from ballbot.firmware.processor_load import SAMPLES, check_clock, measure_load, rehearse
from ballbot.link.emulated import HARDWARE
from tests.support.control_examples import FRICTION, alten, everything, with_policy
from tests.support.firmware_on_processor import firmware_runs, image, image_of, law_runs, presets


@cache
def controllers() -> dict[str, Controller]:
    """Return the presets, and a controller with every part, without and with a policy."""
    whole = everything(alten(FRICTION)).with_estimator("kalman")
    return presets() | {"everything": whole, "policy": with_policy(whole, feedback=0.6)}


@pytest.mark.parametrize("name", ["nominal partial, onboard", "everything", "policy"])
def test_rehearsal_goes_through_every_branch_that_random_states_find(name):
    controller = controllers()[name]
    rehearsed, random = Board(image_of(controller)), Board(image_of(controller))
    updates = list(rehearse(controller, export_controller(controller), rehearsed))
    assert all(update.torques.any() for update in updates)
    assert updates[-1].state["safety"]["stop"][0] == 0
    list(law_runs(controller, lanes=10, count=60, board=random))
    assert random.executed - rehearsed.executed == set()


@pytest.mark.parametrize("name", ["nominal partial, onboard", "everything", "policy"])
def test_rehearsal_has_the_bits_of_this_computer(name):
    assert all(same for _, same in firmware_runs(controllers()[name], samples=60))


@pytest.mark.slow
def test_load_is_the_rehearsal_s():
    controller = controllers()["precise, kalman"]
    exported = export_controller(controller)
    load = measure_load(controller, exported, clock=36e6)
    updates = list(rehearse(controller, exported, Board(image())))
    plain = [update.run for update in updates if not update.has_fix]
    assert load.samples == len(updates) == SAMPLES
    assert load.worst_instructions == max(run.instructions for run in plain)
    assert load.typical_instructions <= load.worst_instructions < (load.fix_instructions or 0)
    assert load.worst_share == load.worst_cycles / (36e6 * 0.005)
    assert load.fix_instructions is not None
    # 200 Hz in a fifth of the time at 72 MHz
    assert CYCLES * load.fix_instructions < 0.2 * CLOCK * controller.sample_time
    assert max(update.run.stack for update in updates) <= load.stack
    assert load.flash > exported.parameter_bytes + 30_000
    # a robot has parameters twice, in use and as a host writes them, and the state
    assert load.ram > 2 * exported.parameter_bytes + exported.state_bytes


def test_link_fits_into_the_stack_that_the_task_s_example_names():
    """What `ballbot export` reports for an update, and 512 bytes more (examples/rtos_task.c)."""
    robot = compile_image(
        [*source_files(), PROJECT / "robot.c", *sorted(HARDWARE.glob("*.c"))],
        include=(SOURCES, PROJECT, HARDWARE),
    )
    bound = robot.stack_bound("ballbot_update") + 512
    assert robot.stack_bound("ballbot_link_receive") < bound
    assert robot.stack_bound("ballbot_link_update") < bound


@pytest.mark.parametrize("clock", [0.0, -72e6, 72.0, 1e12, float("nan")])
def test_impossible_clock_is_refused(clock):
    with pytest.raises(InputError, match="clock of the processor must be between"):
        check_clock(clock)
