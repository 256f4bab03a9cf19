"""Stable-Baselines3 on Ballbot's environments: its checker of each of them, and 50,000 steps of its PPO in one.

.venv/bin/python -m campaigns.evidence stable_baselines

Stable-Baselines3 and PyTorch belong to no extra of Ballbot's: pip install torch stable-baselines3
"""

import warnings
from time import process_time
from typing import Any

import gymnasium
import numpy as np

import ballbot.gym  # noqa: F401 (it registers the environments)
from ballbot.learning.tasks import TASKS
from campaigns.section import DataMissingError, Section

STEPS, EPISODES = 50_000, 20
TRAINED = "Balance"


def campaign() -> Section:
    """Check the environments, train in one, and return the section of docs/generated/evidence.md."""
    try:
        import stable_baselines3
        import torch
        from stable_baselines3 import PPO
        from stable_baselines3.common.env_checker import check_env
    except ImportError as error:
        raise DataMissingError(
            f"it needs {error.name}, which no extra has: pip install torch stable-baselines3"
        ) from None
    torch.set_num_threads(1)
    said = {}
    for name in TASKS:
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always")
            check_env(gymnasium.make(f"ballbot/{name}-v0").unwrapped)
        said[name] = "; ".join(str(warning.message) for warning in raised) or "passed without a warning"
    model = PPO("MlpPolicy", gymnasium.make(f"ballbot/{TRAINED}-v0"), seed=0, device="cpu")
    before, began = episodes(model), process_time()
    model.learn(STEPS)
    seconds, after = process_time() - began, episodes(model)
    learned = [f"{words(before)}", f"{words(after)}", f"{STEPS / seconds:,.0f}"]
    return Section(
        title="Stable-Baselines3 on the environments",
        before=f"The checker of Stable-Baselines3 {stable_baselines3.__version__} on each environment, and "
        f"{STEPS:,} steps of its PPO with its own settings in the single environment of `{TRAINED}` (PyTorch "
        f"{torch.__version__}, one thread): {EPISODES} episodes of the policy without noise, of at most 10 s and a "
        "return of 10, before and after. Its own settings are for other tasks, and 50,000 steps are 500 s of one "
        "robot; `ballbot learn` takes 1.5 million.",
        columns=["environment", "checker", "return, length before", "after", "steps/s of processor time"],
        rows=[
            [f"`ballbot/{name}-v0`", said[name], *(learned if name == TRAINED else ["–", "–", "–"])]
            for name in TASKS
        ],
    )


def episodes(model: Any) -> list[tuple[float, float]]:  # of Stable-Baselines3
    """Return the return and the length [s] of fresh episodes of a policy without its noise."""
    env, ended = gymnasium.make(f"ballbot/{TRAINED}-v0"), []
    for seed in range(1000, 1000 + EPISODES):
        seen, _ = env.reset(seed=seed)
        total, steps, over = 0.0, 0, False
        while not over:
            action, _ = model.predict(seen, deterministic=True)
            seen, reward, fallen, out_of_time, _ = env.step(action)
            total, steps, over = total + float(reward), steps + 1, fallen or out_of_time
        ended.append((total, 0.01 * steps))
    return ended


def words(ended: list[tuple[float, float]]) -> str:
    """Return the means of return and length."""
    total, length = np.mean(ended, axis=0)
    return f"{total:.2f}, {length:.2f} s"
