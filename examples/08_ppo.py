"""Proximal policy optimisation in one file, in the style of CleanRL: a ballbot learns with PyTorch.

    pip install ".[gym]" torch
    python examples/08_ppo.py --task Balance --updates 60 --out learned_with_torch
    ballbot compare learned_with_torch/robot.toml learned_with_torch/controller.toml precise --out compared

The algorithm is that of Schulman et al. 2017 (arXiv:1707.06347), with the advantages of Schulman et al. 2016
(arXiv:1506.02438). It is in PyTorch since that is what its readers change; `ballbot learn` needs none and is faster.
"""

import argparse
import time
from dataclasses import dataclass, fields, replace
from pathlib import Path

import gymnasium
import numpy as np
import torch
from torch import Tensor, nn
from torch.distributions import Normal

import ballbot.gym  # it registers the environments
from ballbot.control.file import write_controller
from ballbot.control.parts.policy import Policy
from ballbot.learning.learn import LARGEST_SPEED, base_controller
from ballbot.learning.tasks import task_named


@dataclass
class Args:
    task: str = "Balance"
    """Balance, Track, Drive or Push"""
    robot: str = "alten"
    """a preset or a robot file"""
    out: str = "learned_with_torch"
    """the folder for controller, robot and contract"""
    seed: int = 0
    """of the robots, the network and the exploration"""
    updates: int = 60
    """improvements of the policy"""
    num_envs: int = 200
    """robots side by side"""
    num_steps: int = 128
    """decisions of each robot between two updates"""
    epochs: int = 2
    """passes through the experience of an update"""
    minibatches: int = 16
    """steps of the descent in a pass"""
    learning_rate: float = 3e-3
    """of Adam at the start; it falls to a tenth"""
    gamma: float = 0.995
    """discount of the reward from a decision to the next"""
    gae_lambda: float = 0.97
    """trace of the generalised advantages"""
    clip: float = 0.2
    """largest change of a decision's probability that gains"""
    exploration: float = 0.3
    """standard deviation of the actions at the start"""
    max_grad_norm: float = 0.5
    """longer slopes are shortened"""


def layer(inputs: int, outputs: int, gain: float) -> nn.Linear:
    """Return a linear layer with orthogonal weights and no bias at first."""
    made = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(made.weight, gain)
    nn.init.zeros_(made.bias)
    return made


def network(inputs: int, outputs: int, last_gain: float) -> nn.Sequential:
    """Return two layers of 64 tanh units and a linear one, the shape that `ballbot export` writes as C."""
    return nn.Sequential(
        layer(inputs, 64, 2**0.5), nn.Tanh(), layer(64, 64, 2**0.5), nn.Tanh(), layer(64, outputs, last_gain)
    )


class Agent(nn.Module):
    """An actor with Gaussian noise, and a critic that knows the true state besides."""

    def __init__(self, observations: int, truths: int, actions: int, exploration: float) -> None:
        super().__init__()
        self.actor = network(observations, actions, 0.01)
        self.critic = network(observations + truths, 1, 1.0)
        self.log_std = nn.Parameter(torch.full((actions,), float(np.log(exploration))))

    def decisions(self, seen: Tensor) -> Normal:
        return Normal(self.actor(seen), self.log_std.exp())

    def value(self, seen: Tensor, truth: Tensor) -> Tensor:
        return self.critic(torch.cat([seen, truth.clamp(-4.0, 4.0)], dim=-1)).squeeze(-1)


def tensor(array: object) -> Tensor:
    return torch.as_tensor(np.asarray(array), dtype=torch.float32)


def train(args: Args) -> tuple[Agent, gymnasium.vector.VectorEnv]:
    """Train an agent; return it with its environments."""
    torch.manual_seed(args.seed)
    envs = gymnasium.make_vec(
        f"ballbot/{args.task}-v0", num_envs=args.num_envs, robot=args.robot, autoreset_mode="SameStep"
    )
    observation, info = envs.reset(seed=args.seed)
    sizes = observation.shape[1], info["truth"].shape[1], envs.single_action_space.shape[0]
    agent = Agent(*sizes, args.exploration)
    adam = torch.optim.Adam(agent.parameters(), lr=args.learning_rate, eps=1e-7)
    T, N = args.num_steps, args.num_envs
    seen, truths, actions = (torch.empty(T, N, size) for size in sizes)
    log_probs, rewards, values, ahead, going = (torch.empty(T, N) for _ in range(5))
    period, start = envs.unwrapped.contract.period, time.monotonic()
    for update in range(1, args.updates + 1):
        adam.param_groups[0]["lr"] = args.learning_rate * (1.0 - 0.9 * (update - 1) / args.updates)
        falls = 0
        with torch.no_grad():
            for t in range(T):
                seen[t], truths[t] = tensor(observation), tensor(info["truth"])
                chosen = agent.decisions(seen[t])
                actions[t], values[t] = chosen.sample(), agent.value(seen[t], truths[t])
                log_probs[t] = chosen.log_prob(actions[t]).sum(-1)
                observation, reward, fallen, out_of_time, info = envs.step(actions[t].numpy())
                # over what a decision can pay at most, so that a value is at most 1
                rewards[t] = tensor(reward) / period * (1.0 - args.gamma)
                ended = fallen | out_of_time
                going[t], falls = tensor(~ended), falls + int(fallen.sum())
                ahead[t] = agent.value(tensor(observation), tensor(info["truth"]))
                ahead[t][tensor(ended).bool()] = 0.0
                for lane in np.flatnonzero(out_of_time):  # it would have gone on
                    last = tensor(info["final_obs"][lane]), tensor(info["final_info"]["truth"][lane])
                    ahead[t, lane] = agent.value(*last)
            advantages, advantage = torch.empty(T, N), torch.zeros(N)
            for t in reversed(range(T)):
                surprise = rewards[t] + args.gamma * ahead[t] - values[t]
                advantage = surprise + args.gamma * args.gae_lambda * going[t] * advantage
                advantages[t] = advantage
        experience = [
            x.flatten(0, 1) for x in (seen, truths, actions, log_probs, advantages, advantages + values)
        ]
        for _ in range(args.epochs):
            for batch in torch.randperm(T * N).chunk(args.minibatches):
                improve(agent, adam, args, *(x[batch] for x in experience))
        print(
            f"update {update:3}: reward {rewards.mean() / (1.0 - args.gamma):.3f} a second, {falls} falls, "
            f"{update * T * N / (time.monotonic() - start):,.0f} decisions/s"
        )
    return agent, envs


def improve(
    agent: Agent, adam: torch.optim.Optimizer, args: Args,
    seen: Tensor, truth: Tensor, action: Tensor, before: Tensor, advantage: Tensor, wanted: Tensor,
) -> None:  # fmt: skip
    """Go a step: up the clipped gain of the actor, down the squared error of the critic."""
    ratio = (agent.decisions(seen).log_prob(action).sum(-1) - before).exp()
    advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
    gain = torch.min(ratio * advantage, ratio.clamp(1.0 - args.clip, 1.0 + args.clip) * advantage)
    loss = ((agent.value(seen, truth) - wanted) ** 2).mean() - gain.mean()
    adam.zero_grad()
    loss.backward()
    nn.utils.clip_grad_norm_(agent.parameters(), args.max_grad_norm)
    adam.step()


def write(agent: Agent, envs: gymnasium.vector.VectorEnv, args: Args) -> Path:
    """Write the policy as a controller, which every command takes, with its robot and contract; return the file."""
    robot, contract, folder = ballbot.Robot.load(args.robot), envs.unwrapped.contract, Path(args.out)
    first, second, last = (
        torch.hstack([one.weight, one.bias[:, None]]).detach().numpy().astype(np.float64)
        for one in agent.actor
        if isinstance(one, nn.Linear)
    )
    policy = Policy(
        feedback=0.0,
        torque_scale=contract.action[0].scale,
        torque_limit=contract.action[0].scale,
        period=contract.period,
        largest_lean=task_named(args.task).fallen,
        largest_speed=LARGEST_SPEED,
        first=first, second=second, last=last,
    )  # fmt: skip
    base = base_controller(robot)
    folder.mkdir(parents=True, exist_ok=True)
    write_controller(base.with_parts(replace(base.parts, policy=policy)), folder / "controller.toml")
    robot.write(folder / "robot.toml")
    contract.write(folder / "contract.json")
    return folder / "controller.toml"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for field in fields(Args):
        name = f"--{field.name.replace('_', '-')}"
        parser.add_argument(name, type=type(field.default), default=field.default)
    args = Args(**vars(parser.parse_args()))
    print(write(*train(args), args))
