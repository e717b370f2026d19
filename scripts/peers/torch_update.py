#!/usr/bin/env python3
"""Times the update of TD3 and MAMF in PyTorch, as it is commonly written.

Eager float32 on the CPU, `nn.Linear` networks, `torch.optim.Adam` with its defaults, minibatches
from a NumPy replay: the style of CleanRL and of the authors' released code. Sizes are those of
HalfCheetah: 17 observations, 6 actions, action coupling 0.7; batch 256, hidden layers of 256.

One update is everything between two steps of the environment: sampling, for MAMF the step of the
dynamics model and the imaginary transitions, the critics, and every second time the actor and
the target networks.

    python scripts/peers/torch_update.py --method mamf --threads 2
"""

import argparse
import copy
import json
import statistics
import time

import numpy as np
import torch
import torch.nn.functional as F
from torch import nn

OBSERVATION, ACTION, A_MAX = 17, 6, 1.0
BATCH, HIDDEN = 256, 256
GAMMA, TAU, POLICY_DELAY, COUPLING = 0.98, 0.005, 2, 0.7
VELOCITY = 8  # forward velocity in the observation of HalfCheetah


class Replay:
    """Ring of transitions (s, a, r, s', d, p); uniform minibatches, s and s' scaled."""

    def __init__(self, capacity, rng):
        self.rng, self.size = rng, capacity
        self.obs = rng.standard_normal((capacity, OBSERVATION), dtype=np.float32)
        self.next_obs = self.obs + 0.1 * rng.standard_normal((capacity, OBSERVATION), dtype=np.float32)
        self.action = rng.uniform(-A_MAX, A_MAX, (capacity, ACTION)).astype(np.float32)
        self.prev_action = rng.uniform(-A_MAX, A_MAX, (capacity, ACTION)).astype(np.float32)
        self.reward = (self.obs[:, VELOCITY] - 0.1 * (self.action**2).sum(1))[:, None]
        self.terminated = np.zeros((capacity, 1), dtype=np.float32)
        self.mean = self.obs.mean(0)
        self.deviation = np.maximum(self.obs.std(0), 1e-2)

    def scale(self, obs):
        return np.clip((obs - self.mean) / self.deviation, -5, 5)

    def sample(self):
        rows = self.rng.integers(0, self.size, BATCH)
        batch = (
            self.scale(self.obs[rows]),
            self.action[rows],
            self.reward[rows],
            self.scale(self.next_obs[rows]),
            self.terminated[rows],
            self.prev_action[rows],
        )
        return [torch.from_numpy(x) for x in batch]


class Actor(nn.Module):
    def __init__(self):
        super().__init__()
        self.l1 = nn.Linear(OBSERVATION + ACTION, HIDDEN)
        self.l2 = nn.Linear(HIDDEN, HIDDEN)
        self.l3 = nn.Linear(HIDDEN, ACTION)

    def forward(self, s, p):
        x = F.relu(self.l1(torch.cat([s, p], 1)))
        x = F.relu(self.l2(x))
        return A_MAX * torch.tanh(self.l3(x))


class Critic(nn.Module):
    """Both Q functions."""

    def __init__(self):
        super().__init__()
        inputs = OBSERVATION + 2 * ACTION
        self.l1, self.l2, self.l3 = nn.Linear(inputs, HIDDEN), nn.Linear(HIDDEN, HIDDEN), nn.Linear(HIDDEN, 1)
        self.l4, self.l5, self.l6 = nn.Linear(inputs, HIDDEN), nn.Linear(HIDDEN, HIDDEN), nn.Linear(HIDDEN, 1)

    def q1(self, s, p, a):
        x = torch.cat([s, p, a], 1)
        return self.l3(F.relu(self.l2(F.relu(self.l1(x)))))

    def forward(self, s, p, a):
        x = torch.cat([s, p, a], 1)
        q1 = self.l3(F.relu(self.l2(F.relu(self.l1(x)))))
        q2 = self.l6(F.relu(self.l5(F.relu(self.l4(x)))))
        return q1, q2


class DynamicsModel(nn.Module):
    def __init__(self):
        super().__init__()
        self.l1 = nn.Linear(OBSERVATION + ACTION, HIDDEN)
        self.l2 = nn.Linear(HIDDEN, HIDDEN)
        self.l3 = nn.Linear(HIDDEN, HIDDEN)
        self.l4 = nn.Linear(HIDDEN, OBSERVATION)

    def forward(self, s, a):
        x = F.relu(self.l1(torch.cat([s, a], 1)))
        x = F.relu(self.l2(x))
        x = F.relu(self.l3(x))
        return self.l4(x)


class TD3:
    def __init__(self, replay):
        self.replay = replay
        self.actor, self.critic = Actor(), Critic()
        self.actor_target, self.critic_target = copy.deepcopy(self.actor), copy.deepcopy(self.critic)
        self.actor_optimizer = torch.optim.Adam(self.actor.parameters(), lr=3e-4)
        self.critic_optimizer = torch.optim.Adam(self.critic.parameters(), lr=3e-4)
        self.updates = 0

    def couple(self, u, p):
        return COUPLING * u + (1 - COUPLING) * p

    def target(self, reward, terminated, next_obs, action):
        """y = r + gamma (1 - d) min(Q1', Q2')(s', a'), and |Q1' - Q2'|."""
        noise = (torch.randn_like(action) * 0.2 * A_MAX).clamp(-0.5 * A_MAX, 0.5 * A_MAX)
        u = (self.actor_target(next_obs, action) + noise).clamp(-A_MAX, A_MAX)
        q1, q2 = self.critic_target(next_obs, action, self.couple(u, action))
        return reward + GAMMA * (1 - terminated) * torch.min(q1, q2), (q1 - q2).abs()

    def update(self):
        obs, action, reward, next_obs, terminated, prev_action = self.replay.sample()
        with torch.no_grad():
            y, _ = self.target(reward, terminated, next_obs, action)
        q1, q2 = self.critic(obs, prev_action, action)
        self.critic_step(F.mse_loss(q1, y) + F.mse_loss(q2, y))
        self.delayed_step(obs, prev_action)

    def critic_step(self, loss):
        self.critic_optimizer.zero_grad()
        loss.backward()
        self.critic_optimizer.step()

    def delayed_step(self, obs, prev_action):
        self.updates += 1
        if self.updates % POLICY_DELAY != 0:
            return
        action = self.couple(self.actor(obs, prev_action), prev_action)
        loss = -self.critic.q1(obs, prev_action, action).mean()
        self.actor_optimizer.zero_grad()
        loss.backward()
        self.actor_optimizer.step()
        for online, target in [(self.critic, self.critic_target), (self.actor, self.actor_target)]:
            for x, x_target in zip(online.parameters(), target.parameters()):
                x_target.data.copy_(TAU * x.data + (1 - TAU) * x_target.data)


class MAMF(TD3):
    def __init__(self, replay):
        super().__init__(replay)
        self.model = DynamicsModel()
        self.model_optimizer = torch.optim.Adam(self.model.parameters(), lr=1e-4)
        self.mean, self.deviation = torch.from_numpy(replay.mean), torch.from_numpy(replay.deviation)
        self.eta, self.rho = A_MAX, 0.9999996

    def update(self):
        self.model_step()
        obs, action, reward, next_obs, terminated, prev_action = self.replay.sample()
        with torch.no_grad():
            y, _ = self.target(reward, terminated, next_obs, action)
            imagined, y_imagined, keep = self.imagine(obs, prev_action, y)

        # Real and imaginary rows in one batch of 2N; dropped rows count as 0.
        q1, q2 = self.critic(
            torch.cat([obs, obs]), torch.cat([prev_action, prev_action]), torch.cat([action, imagined])
        )
        targets, weights = torch.cat([y, y_imagined]), torch.cat([torch.ones_like(keep), keep])
        loss = sum((weights * (q - targets) ** 2).sum() / BATCH for q in (q1, q2))
        self.critic_step(loss)
        self.delayed_step(obs, prev_action)

    def model_step(self):
        obs, action, _, next_obs, _, _ = self.replay.sample()
        loss = F.mse_loss(self.model(obs, action), next_obs)
        self.model_optimizer.zero_grad()
        loss.backward()
        self.model_optimizer.step()

    def imagine(self, obs, prev_action, y):
        """Imaginary actions, their targets, and 1 for the rows that pass both filters."""
        nu = torch.randn_like(prev_action).clamp(-self.eta, self.eta)
        self.eta *= self.rho
        action = self.couple(self.actor(obs, prev_action) + nu, prev_action).clamp(-A_MAX, A_MAX)

        # The reward rule wants observations that are not scaled. HalfCheetah never terminates.
        raw_obs = obs * self.deviation + self.mean
        raw_next_obs = self.model(obs, action) * self.deviation + self.mean
        velocity = (raw_obs[:, VELOCITY] + raw_next_obs[:, VELOCITY]) / 2
        reward = (velocity - 0.1 * (action**2).sum(1)).unsqueeze(1)
        next_obs = ((raw_next_obs - self.mean) / self.deviation).clamp(-5, 5)

        y_imagined, delta = self.target(reward, torch.zeros_like(reward), next_obs, action)
        higher = y_imagined > y
        uncertain = torch.rand_like(delta) < delta / delta.max()
        return action, y_imagined, (higher & uncertain).float()


def main():
    parser = argparse.ArgumentParser(description="Time the update of TD3 or MAMF in PyTorch.")
    parser.add_argument("--method", choices=["td3", "mamf"], default="mamf", help="default: %(default)s")
    parser.add_argument("--threads", type=int, default=2, help="threads of PyTorch (default: %(default)s)")
    parser.add_argument("--rounds", type=int, default=10, help="timed rounds (default: %(default)s)")
    parser.add_argument("--updates", type=int, default=100, help="updates a round (default: %(default)s)")
    parser.add_argument(
        "--replay", type=int, default=100_000, help="transitions in the replay (default: %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="print the result as one JSON object")
    arguments = parser.parse_args()

    torch.set_num_threads(arguments.threads)
    torch.manual_seed(0)
    replay = Replay(arguments.replay, np.random.default_rng(0))
    agent = {"td3": TD3, "mamf": MAMF}[arguments.method](replay)

    for _ in range(arguments.updates):  # warm-up
        agent.update()
    milliseconds = []
    for _ in range(arguments.rounds):
        start = time.perf_counter()
        for _ in range(arguments.updates):
            agent.update()
        milliseconds.append(1e3 * (time.perf_counter() - start) / arguments.updates)

    result = {
        "method": arguments.method,
        "threads": arguments.threads,
        "torch": torch.__version__,
        "median_ms": statistics.median(milliseconds),
        "min_ms": min(milliseconds),
        "max_ms": max(milliseconds),
    }
    if arguments.json:
        print(json.dumps(result))
    else:
        print(
            "{method}, {threads} threads, PyTorch {torch}: {median_ms:.2f} ms an update"
            " (median of rounds; {min_ms:.2f} to {max_ms:.2f})".format(**result)
        )


if __name__ == "__main__":
    main()
