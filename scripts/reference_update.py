#!/usr/bin/env python3
"""Training steps of all methods in double precision, written as fixtures for the tests.

TD3 and MAMF, and what the paper compares them with: DDPG, SAC, MVE-TD3, MA-TD3, TD3 with two
critic updates a step, MAMF on SAC, MAMF with a learned reward.

This is a second, independent implementation of one training step of phase 2 (Algorithm 1,
lines 18-26): dynamics model, critics, actor, Polyak averaging. It is written to be compared
with the paper, not to be fast: float64, PyTorch's autograd for the derivatives, all N imaginary
rows computed, one pass per network and argument. Equation numbers are the paper's.

Every case draws small random networks, three batches and the noise from a fixed seed, takes three
consecutive steps and writes one file `<case>.safetensors`. All inputs are float32 numbers, so
that single precision code starts from exactly the same values.

    python scripts/reference_update.py --out tests/fixtures/update           # write
    python scripts/reference_update.py --out tests/fixtures/update --check   # recompute, compare

Notation and shapes: N rows a batch, S observation size, A action size;
s, s' [N, S]; a, p (the action executed before a) [N, A]; r, d (1 where terminated) [N].
Layers compute y = x W + b with W [in, out].

What the tensors of a file are called is described in `tests/fixtures/update/README.md`.
"""

import argparse
import json
import sys
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from safetensors import safe_open
from safetensors.numpy import save_file

STEPS = 3
CLIP_SCALED = 5.0  # bound of scaled observations
SMOOTHING_DEVIATION, SMOOTHING_BOUND = 0.2, 0.5  # target smoothing, in units of a_max
LOG_DEVIATION = (-20.0, 2.0)  # bounds of SAC's log-deviations
TIE = 1e-4  # no decision of a case may be closer than this to turning out the other way


# ---------------------------------------------------------------------------------------------
# Settings
# ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Settings:
    """One case. Stored as JSON under the key `settings` of the file's metadata."""

    case: str
    seed: int
    imagination: bool  # imaginary transitions beside the real ones
    task: str = "Hopper-v4"
    beta: float = 0.7  # action coupling; 1 leaves p out of every input
    gamma: float = 0.98
    tau: float = 0.005
    eta: float = 1.0  # bound of the imaginary noise in step 0
    rho: float = 0.9  # eta <- eta * rho after each step
    noise_decay: bool = True
    predict: str = "next_state"  # or "delta"
    velocity: str = "start"  # forward velocity of the reward rule: "start" or "mean"
    target_filter: bool = True  # eq. (8)
    strict: bool = False  # eq. (8) with > instead of >=
    uncertainty_filter: bool = True  # eq. (9)
    uncertainty_scale: str = "running_max"  # or "batch_max"
    running_max: float = 0.0  # largest Delta seen before step 0
    imaginary_loss_mean: str = "kept"  # second mean of eq. (10) over n ("kept") or N ("batch")
    policy_delay: int = 2  # actor and targets move in step i when (i + 1) % policy_delay == 0
    actor_lr: float = 3e-4
    critic_lr: float = 3e-4
    model_lr: float = 1e-4
    adam_betas: tuple = (0.9, 0.999)
    adam_epsilon: float = 1e-8
    batch_size: int = 64
    hidden: tuple = (32, 32)  # actor and critics
    model_hidden: tuple = (32, 32, 32)
    steps: int = STEPS
    base: str = "td3"  # or "ddpg", "sac"
    horizon: int = 0  # model-based value expansion over so many positions; 0: none
    noise_deviation: float = 1.0  # of the imaginary noise, before it is clipped at eta ...
    noise_relative: bool = False  # ... in units of a_max
    critic_updates: int = 1  # a step; the first of 2 has a batch of its own
    reward: str = "known"  # or "learned": the model's last output
    temperature_lr: float = 3e-4
    initial_temperature: float = 0.1

    def __post_init__(self):
        assert self.base in ("td3", "ddpg", "sac") and self.reward in ("known", "learned")
        assert self.base == "td3" or self.horizon == 0
        assert self.base != "ddpg" or not self.imagination  # one critic cannot disagree with itself
        assert not (self.imagination and self.horizon > 0)
        assert self.critic_updates in (1, 2)

    @property
    def has_model(self):
        return self.imagination or self.horizon > 0

    @property
    def critics(self):
        return ("critic1",) if self.base == "ddpg" else ("critic1", "critic2")

    @property
    def rules(self):
        return RULES[self.task](self.velocity)

    @property
    def a_max(self):
        return RULES[self.task].a_max


CASES = [
    Settings("td3", seed=1, imagination=False),
    Settings("td3_uncoupled", seed=2, imagination=False, beta=1.0),
    # What the paper's text says ...
    Settings("mamf_paper", seed=103, imagination=True, velocity="mean"),
    # ... and what the authors' released implementation does.
    Settings(
        "mamf_released",
        seed=4,
        imagination=True,
        uncertainty_scale="batch_max",
        imaginary_loss_mean="batch",
        strict=True,
    ),
    Settings("mamf_no_target_filter", seed=106, imagination=True, target_filter=False, running_max=6.5),
    Settings("mamf_no_uncertainty_filter", seed=7, imagination=True, uncertainty_filter=False),
    Settings("mamf_delta", seed=8, imagination=True, predict="delta", running_max=8.9, velocity="mean"),
    # The largest difference ever seen is so large that P is about 0: n = 0 in every step.
    Settings("mamf_nothing_kept", seed=9, imagination=True, running_max=1e9),
    Settings("mamf_reacher", seed=410, imagination=True, task="Reacher-v4", running_max=2.5),
    # Rewards are all 1, so y_hat = y = 1 exactly where both transitions terminate: >= and > differ.
    # a_max is 3; the second one is without action coupling as well.
    Settings(
        "mamf_pendulum", seed=111, imagination=True, task="InvertedPendulum-v4", eta=3.0, running_max=6.4
    ),
    Settings(
        "mamf_pendulum_uncoupled",
        seed=1112,
        imagination=True,
        task="InvertedPendulum-v4",
        beta=1.0,
        eta=3.0,
        strict=True,
        uncertainty_scale="batch_max",
        noise_decay=False,
    ),
    Settings("ddpg", seed=201, imagination=False, base="ddpg", policy_delay=1),
    Settings("ddpg_uncoupled", seed=202, imagination=False, base="ddpg", policy_delay=1, beta=1.0),
    Settings("sac", seed=203, imagination=False, base="sac", policy_delay=1),
    Settings("sac_uncoupled", seed=404, imagination=False, base="sac", policy_delay=1, beta=1.0),
    Settings(
        "sac_pendulum",
        seed=305,
        imagination=False,
        task="InvertedPendulum-v4",
        base="sac",
        policy_delay=1,
    ),
    Settings("mve", seed=222, imagination=False, horizon=3, velocity="mean"),
    Settings(
        "mve_pendulum",
        seed=207,
        imagination=False,
        task="InvertedPendulum-v4",
        horizon=3,
        beta=1.0,
        predict="delta",
    ),
    Settings("mve_reacher_h1", seed=208, imagination=False, task="Reacher-v4", horizon=1),
    # Fixed noise like that of target smoothing, no target filter.
    Settings(
        "ma_td3",
        seed=209,
        imagination=True,
        target_filter=False,
        noise_decay=False,
        noise_deviation=0.2,
        noise_relative=True,
        eta=0.5,
    ),
    Settings(
        "ma_td3_pendulum",
        seed=310,
        imagination=True,
        task="InvertedPendulum-v4",
        target_filter=False,
        noise_decay=False,
        noise_deviation=0.2,
        noise_relative=True,
        eta=1.5,
    ),
    Settings("mamf_sac", seed=311, imagination=True, base="sac", policy_delay=1),
    # Some coordinates are known here, so that an output counted as a coordinate would show.
    Settings("mamf_learned_reward", seed=312, imagination=True, task="Reacher-v4", reward="learned"),
    Settings("td3_critic2", seed=213, imagination=False, critic_updates=2),
]


# ---------------------------------------------------------------------------------------------
# What the designer of a task knows, on observations that are not scaled
# ---------------------------------------------------------------------------------------------


class Rules:
    """Base: no termination, nothing known. `mean` and `deviation` only shape the random data."""

    known = ()  # coordinates of s' that `complete` fills in and the model does not predict

    def __init__(self, velocity):
        self.velocity = velocity

    def reward(self, s, a, s_next):
        """r(s, a, s') -> [N]"""
        raise NotImplementedError

    def terminated(self, s_next):
        """True where the task really ended -> [N]"""
        return torch.zeros(len(s_next), dtype=torch.bool)

    def complete(self, s, a, s_next):
        """Overwrites the known coordinates of s' -> [N, S]"""
        return s_next

    def limits(self, s_next):
        """Pairs (quantity [N], bound) that `terminated` compares; to keep clear of ties."""
        return []


class Hopper(Rules):
    size, actions, a_max = 11, 3, 1.0
    mean = [1.2, 0.02, -0.1, -0.2, 0.05, 1.0, -0.1, 0.03, -0.2, -0.1, 0.1]
    deviation = [0.25, 0.1, 0.2, 0.2, 0.5, 0.8, 1.3, 1.2, 2.0, 2.1, 4.0]

    def reward(self, s, a, s_next):
        v = s[:, 5] if self.velocity == "start" else (s[:, 5] + s_next[:, 5]) / 2
        return v + 1 - 0.001 * (a**2).sum(1)

    def terminated(self, s_next):
        height, angle, rest = s_next[:, 0], s_next[:, 1], s_next[:, 1:]
        healthy = (height > 0.7) & (angle.abs() < 0.2) & (rest.abs() < 100).all(1)
        return ~healthy

    def limits(self, s_next):
        return [(s_next[:, 0], 0.7), (s_next[:, 1].abs(), 0.2), (s_next[:, 1:].abs().amax(1), 100.0)]


class Reacher(Rules):
    size, actions, a_max = 11, 2, 1.0
    known = (4, 5, 10)  # the position of the target; both points lie in one plane, so 10 is constant
    mean = [0.6, 0.5, 0.1, -0.1, 0.01, -0.02, 0.1, -0.3, 0.03, 0.02, 0.01]
    deviation = [0.4, 0.5, 0.6, 0.7, 0.1, 0.12, 4.0, 6.0, 0.15, 0.14, 0.01]

    def reward(self, s, a, s_next):
        return -s[:, 8:11].norm(dim=1) - (a**2).sum(1)  # both before the action

    def complete(self, s, a, s_next):
        s_next = s_next.clone()
        known = list(self.known)
        s_next[:, known] = s[:, known]
        return s_next


class InvertedPendulum(Rules):
    size, actions, a_max = 4, 1, 3.0
    mean = [0.02, -0.01, 0.1, 0.05]
    deviation = [0.3, 0.15, 0.9, 1.8]

    def reward(self, s, a, s_next):
        return torch.ones(len(s), dtype=s.dtype)

    def terminated(self, s_next):
        return s_next[:, 1].abs() > 0.2

    def limits(self, s_next):
        return [(s_next[:, 1].abs(), 0.2)]


RULES = {"Hopper-v4": Hopper, "Reacher-v4": Reacher, "InvertedPendulum-v4": InvertedPendulum}


# ---------------------------------------------------------------------------------------------
# The mathematics
# ---------------------------------------------------------------------------------------------


def clip(x, bound):
    return x.clamp(-bound, bound)


@dataclass
class Position:
    """One position of model-based value expansion; s is scaled, y follows from the positions behind."""

    s: torch.Tensor
    p: torch.Tensor
    a: torch.Tensor
    r: torch.Tensor
    d: torch.Tensor
    mask: torch.Tensor  # 1 where the row is trained
    y: torch.Tensor = None


class Learner:
    """Networks, optimisers and counters of one run; `step` is one training step of phase 2."""

    def __init__(self, settings, inputs, dtype=torch.float64):
        self.settings, self.rules, self.dtype = settings, settings.rules, dtype
        self.mean = self.tensor(inputs["in.scaling.mean"])
        self.deviation = self.tensor(inputs["in.scaling.deviation"])
        known = set(self.rules.known)
        self.trained = [j for j in range(self.rules.size) if j not in known]

        # {"actor": [(W1, b1), (W2, b2), ...], "critic1": ..., "target_actor": ..., ...}
        self.networks = {}
        for name in network_sizes(settings):
            layers, number = [], 1
            while f"in.{name}.l{number}.weight" in inputs:
                weight = self.tensor(inputs[f"in.{name}.l{number}.weight"])
                bias = self.tensor(inputs[f"in.{name}.l{number}.bias"])
                learned = not name.startswith("target_")
                layers.append((weight.requires_grad_(learned), bias.requires_grad_(learned)))
                number += 1
            self.networks[name] = layers

        self.adam = {
            name: torch.optim.Adam(
                [parameter for layer in self.networks[name] for parameter in layer],
                lr=rate,
                betas=settings.adam_betas,
                eps=settings.adam_epsilon,
                foreach=False,
            )
            for name, rate in [
                ("actor", settings.actor_lr),
                ("critic1", settings.critic_lr),
                ("critic2", settings.critic_lr),
                ("model", settings.model_lr),
            ]
            if name in self.networks
        }
        if settings.base == "sac":
            self.log_alpha = self.tensor(inputs["in.log_alpha"]).requires_grad_()
            self.target_entropy = -self.rules.actions
            self.adam["log_alpha"] = torch.optim.Adam(
                [self.log_alpha],
                lr=settings.temperature_lr,
                betas=settings.adam_betas,
                eps=settings.adam_epsilon,
                foreach=False,
            )
        self.eta = settings.eta
        self.running_max = settings.running_max

    def tensor(self, array):
        return torch.tensor(array, dtype=self.dtype)

    # -- networks ------------------------------------------------------------------------------

    def forward(self, name, *inputs):
        """Concatenated inputs through the layers of a network, ReLU between them."""
        x = torch.cat(inputs, dim=1)
        *hidden, last = self.networks[name]
        for weight, bias in hidden:
            x = torch.relu(x @ weight + bias)
        weight, bias = last
        return x @ weight + bias

    def pi(self, name, s, p):
        """Actor: [s, p] -> u in [-a_max, a_max]; p is an input only under action coupling.

        Of SAC's actor this is the deterministic action, that of the mean.
        """
        inputs = (s, p) if self.settings.beta < 1 else (s,)
        mean = self.forward(name, *inputs)[:, : self.rules.actions]
        return self.settings.a_max * torch.tanh(mean)

    def sample(self, s, p, z):
        """SAC's actor: u = a_max tanh(x), x = m + exp(l) z. Returns u and log pi [N], and l unclamped.

        log pi is the log-density of u / a_max: that of x less sum of log(1 - tanh(x)^2).
        """
        inputs = (s, p) if self.settings.beta < 1 else (s,)
        mean, unclamped = self.forward("actor", *inputs).chunk(2, dim=1)
        log_deviation = unclamped.clamp(*LOG_DEVIATION)
        x = mean + torch.exp(log_deviation) * z
        # log(1 - tanh(x)^2) = 2 (log 2 - x - softplus(-2 x)), which does not lose its digits
        log_slope = 2 * (np.log(2) - x - torch.logaddexp(torch.zeros_like(x), -2 * x))
        log_pi = (-(z**2) / 2 - log_deviation - np.log(2 * np.pi) / 2 - log_slope).sum(1)
        return self.settings.a_max * torch.tanh(x), log_pi, unclamped

    def q(self, name, s, p, a):
        """Critic: [s, p, a] -> Q [N]; p is an input only under action coupling."""
        inputs = (s, p, a) if self.settings.beta < 1 else (s, a)
        return self.forward(name, *inputs).squeeze(1)

    def couple(self, u, p):
        """Executed action: beta u + (1 - beta) p."""
        return self.settings.beta * u + (1 - self.settings.beta) * p

    def scale(self, s):
        return clip((s - self.mean) / self.deviation, CLIP_SCALED)

    # -- targets -------------------------------------------------------------------------------

    def value(self, s_next, a, noise):
        """What a target discounts: min(Q1', Q2')(s', a') in eq. (4). Returns it and |Q1' - Q2'|, both [N].

        a' is coupled with a, the action executed before it. s' is scaled. a' is
        TD3:  the smoothed action of the target actor;
        DDPG: the action of the target actor, and there is only Q1';
        SAC:  a sample of the online actor, and alpha log pi is subtracted.
        """
        a_max, base = self.settings.a_max, self.settings.base
        if base == "sac":
            u_next, log_pi, _ = self.sample(s_next, a, noise)
        elif base == "ddpg":
            u_next = self.pi("target_actor", s_next, a)
        else:
            epsilon = clip(SMOOTHING_DEVIATION * a_max * noise, SMOOTHING_BOUND * a_max)
            u_next = clip(self.pi("target_actor", s_next, a) + epsilon, a_max)
        a_next = self.couple(u_next, a)
        q1 = self.q("target_critic1", s_next, a, a_next)
        if base == "ddpg":
            return q1, None
        q2 = self.q("target_critic2", s_next, a, a_next)
        value = torch.minimum(q1, q2)
        if base == "sac":
            value = value - torch.exp(self.log_alpha) * log_pi
        return value, (q1 - q2).abs()

    def target(self, r, d, s_next, a, noise):
        """Eq. (4): y = r + gamma (1 - d) value(s'). Returns y and |Q1' - Q2'|, both [N]."""
        value, delta = self.value(s_next, a, noise)
        return r + self.settings.gamma * (1 - d) * value, delta

    # -- one step ------------------------------------------------------------------------------

    def step(self, i, inputs):
        """Training step i. Returns its results by name, and the distances to ties."""
        out, ties = {}, []
        batch, model_batch, extra, noise = (
            {
                name.removeprefix(f"in.{i}.{group}."): self.tensor(array)
                for name, array in inputs.items()
                if name.startswith(f"in.{i}.{group}.")
            }
            for group in ("batch", "model_batch", "extra_batch", "noise")
        )

        # A critic update more, with a batch of its own.
        if self.settings.critic_updates == 2:
            self.extra_update(extra, noise["smoothing_extra"], out)

        # Line 18: the dynamics model, on a batch of its own.
        if self.settings.has_model:
            out["model_loss"] = self.model_step(model_batch)

        # Line 19: the sampled transitions and their targets, eq. (4).
        raw_s, a, p = batch["obs"], batch["action"], batch["prev_action"]
        s, s_next = self.scale(raw_s), self.scale(batch["next_obs"])
        with torch.no_grad():
            if self.settings.horizon > 0:
                positions = self.expand(batch, noise["smoothing"], out, ties)
                y = positions[0].y
            else:
                y, _ = self.target(
                    batch["reward"], batch["terminated"], s_next, a, noise.get("smoothing")
                )
        out["y"] = y

        # Lines 19 to 21: imaginary transitions of the same states, and the two filters.
        if self.settings.imagination:
            with torch.no_grad():
                a_hat, y_hat, delta = self.imagine(s, raw_s, p, noise, out, ties)
                keep = self.filter(y, y_hat, delta, noise["keep"], out, ties)
            out.update(a_hat=a_hat, y_hat=y_hat, delta=delta, keep_mask=keep)
            out["eta"] = torch.tensor(self.eta, dtype=torch.float64)
            if self.settings.noise_decay:
                self.eta *= self.settings.rho  # line 20

        # Line 22: both critics, eq. (10).
        for critic in self.settings.critics:
            if self.settings.horizon > 0:
                # Every position has the same weight, every row of it 1 / N, masked rows 0.
                loss = sum(
                    (x.mask * (self.q(critic, x.s, x.p, x.a) - x.y) ** 2).mean() for x in positions
                ) / len(positions)
            else:
                loss = ((self.q(critic, s, p, a) - y) ** 2).mean()
            if self.settings.imagination:
                squares = (self.q(critic, s, p, a_hat) - y_hat) ** 2
                kept = squares[keep]
                if self.settings.imaginary_loss_mean == "batch":
                    loss = loss + kept.sum() / len(squares)
                elif len(kept) > 0:
                    loss = loss + kept.sum() / len(kept)
            self.descend(critic, loss)
            out[f"{critic}_loss"] = loss.detach()

        # Lines 23 to 26: actor, with the critics just updated, and target networks.
        if (i + 1) % self.settings.policy_delay == 0:
            if self.settings.base == "sac":
                self.sac_actor_step(s, p, noise["policy"], out, ties)
            else:
                loss = -self.q("critic1", s, p, self.couple(self.pi("actor", s, p), p)).mean()
                self.descend("actor", loss)
                out["actor_loss"] = loss.detach()
            self.polyak()
        return out, ties

    def extra_update(self, batch, noise, out):
        """Both critics, once, on real transitions alone."""
        a, p = batch["action"], batch["prev_action"]
        s, s_next = self.scale(batch["obs"]), self.scale(batch["next_obs"])
        with torch.no_grad():
            y, _ = self.target(batch["reward"], batch["terminated"], s_next, a, noise)
        out["extra_y"] = y
        for critic in self.settings.critics:
            loss = ((self.q(critic, s, p, a) - y) ** 2).mean()
            self.descend(critic, loss)
            out[f"extra_{critic}_loss"] = loss.detach()

    def sac_actor_step(self, s, p, z, out, ties):
        """SAC's actor, then its temperature; both losses hold the values before either moves."""
        u, log_pi, log_deviation = self.sample(s, p, z)
        a = self.couple(u, p)
        q1, q2 = self.q("critic1", s, p, a), self.q("critic2", s, p, a)
        alpha = torch.exp(self.log_alpha.detach())
        loss = (alpha * log_pi - torch.minimum(q1, q2)).mean()
        self.descend("actor", loss)

        # Where these turn out the other way, so does the path of a gradient.
        low, high = LOG_DEVIATION
        margins = [log_deviation - low, log_deviation - high, (q1 - q2) / q1.abs().clamp(min=1)]
        ties += [margin.detach().abs() for margin in margins]
        clamped = torch.stack([(log_deviation < low).sum(), (log_deviation > high).sum()])
        out.update(actor_loss=loss.detach(), log_pi=log_pi.detach().mean(), log_deviation_clamped=clamped)

        loss = -(self.log_alpha * (log_pi.detach() + self.target_entropy).mean()).sum()
        self.descend("log_alpha", loss)
        out["temperature_loss"] = loss.detach()
        out["log_alpha"] = self.log_alpha.detach().clone()

    def model_step(self, batch):
        """Eq. (5) in scaled space, over the coordinates that are not known (and a learned reward)."""
        s, s_next = self.scale(batch["obs"]), self.scale(batch["next_obs"])
        target = (s_next - s if self.settings.predict == "delta" else s_next)[:, self.trained]
        if self.settings.reward == "learned":
            target = torch.cat([target, batch["reward"].unsqueeze(1)], dim=1)
        error = self.forward("model", s, batch["action"]) - target
        loss = (error**2).mean()
        self.descend("model", loss)
        return loss.detach()

    def imagine(self, s, raw_s, p, noise, out, ties):
        """Eq. (7) and the target of the imaginary transition. Returns a_hat, y_hat, Delta."""
        unit = self.settings.a_max if self.settings.noise_relative else 1.0
        nu = clip(self.settings.noise_deviation * unit * noise["imaginary"], self.eta)
        a_hat = clip(self.couple(self.pi("actor", s, p) + nu, p), self.settings.a_max)

        raw_s_hat, r_hat, d_hat, beyond = self.predict(raw_s, a_hat, ties)
        y_hat, delta = self.target(
            r_hat, d_hat.to(self.dtype), self.scale(raw_s_hat), a_hat, noise["smoothing_imaginary"]
        )
        out.update(r_hat=r_hat, d_hat=d_hat, s_hat_clipped=beyond)
        return a_hat, y_hat, delta

    def predict(self, raw_s, a, ties):
        """The model and the rules: s', r, d of taking a in s. s and s' are not scaled.

        Also returns how many numbers of s' are beyond the bound of scaled observations.
        """
        s = self.scale(raw_s)
        output = self.forward("model", s, a)
        prediction = torch.zeros_like(s)
        prediction[:, self.trained] = output[:, : len(self.trained)]
        if self.settings.predict == "delta":
            prediction = prediction + s
        raw_s_next = self.rules.complete(raw_s, a, self.mean + self.deviation * prediction)

        r = self.rules.reward(raw_s, a, raw_s_next)
        if self.settings.reward == "learned":
            r = output[:, -1]
        d = self.rules.terminated(raw_s_next)
        for quantity, bound in self.rules.limits(raw_s_next):
            ties.append((quantity - bound).abs() / bound)
        beyond = ((raw_s_next - self.mean) / self.deviation).abs() > CLIP_SCALED
        return raw_s_next, r, d, beyond.sum()

    def expand(self, batch, noise, out, ties):
        """Model-based value expansion: positions 0 (the sampled transition) to H, with their targets."""
        first = Position(
            s=self.scale(batch["obs"]),
            p=batch["prev_action"],
            a=batch["action"],
            r=batch["reward"],
            d=batch["terminated"],
            mask=torch.ones_like(batch["reward"]),
        )
        positions, raw_s, clipped = [first], batch["next_obs"], 0
        for _ in range(self.settings.horizon):
            last = positions[-1]
            s, p = self.scale(raw_s), last.a
            a = self.couple(self.pi("actor", s, p), p)
            raw_s, r, d, beyond = self.predict(raw_s, a, ties)
            # Nothing is trained behind a termination.
            positions.append(Position(s, p, a, r, d.to(self.dtype), mask=last.mask * (1 - last.d)))
            clipped = clipped + beyond

        y, _ = self.value(self.scale(raw_s), positions[-1].a, noise)
        for position in reversed(positions):
            y = position.r + self.settings.gamma * (1 - position.d) * y
            position.y = y
        out.update(
            y_positions=torch.stack([x.y for x in positions]),
            mask=torch.stack([x.mask for x in positions]),
            a_positions=torch.stack([x.a for x in positions]),
            s_hat_clipped=clipped,
        )
        return positions

    def filter(self, y, y_hat, delta, uniform, out, ties):
        """Eqs. (8) and (9). Returns the mask of the rows that pass both filters."""
        target_mask = torch.ones_like(y, dtype=torch.bool)
        if self.settings.target_filter:
            target_mask = y_hat > y if self.settings.strict else y_hat >= y
            difference = (y_hat - y).abs() / y.abs().clamp(min=1)
            ties.append(difference[difference > 0])  # exact equality is no risk

        uncertainty_mask = torch.ones_like(y, dtype=torch.bool)
        if self.settings.uncertainty_filter:
            largest = delta.max().item()  # over all rows, those that eq. (8) dropped included
            if self.settings.uncertainty_scale == "running_max":
                largest = self.running_max = max(largest, self.running_max)
                out["running_max"] = torch.tensor(self.running_max, dtype=torch.float64)
            if largest > 0:
                probability = delta / largest
                uncertainty_mask = uniform < probability
                ties.append((uniform - probability).abs())
            else:
                uncertainty_mask[:] = False

        out.update(target_mask=target_mask, uncertainty_mask=uncertainty_mask)
        return target_mask & uncertainty_mask

    def descend(self, name, loss):
        """One Adam step of one network, or of log_alpha."""
        optimiser = self.adam[name]
        optimiser.zero_grad()
        parameters = optimiser.param_groups[0]["params"]
        for parameter, gradient in zip(parameters, torch.autograd.grad(loss, parameters)):
            parameter.grad = gradient
        optimiser.step()

    def polyak(self):
        """phi' <- (1 - tau) phi' + tau phi, and the same for theta'."""
        tau = self.settings.tau
        for name in [name for name in self.networks if f"target_{name}" in self.networks]:
            for online, target in zip(self.networks[name], self.networks[f"target_{name}"]):
                for x, x_target in zip(online, target):
                    x_target.copy_((1 - tau) * x_target + tau * x.detach())

    def parameters(self):
        """All parameters by name: {"actor.l1.weight": [in, out], "actor.l1.bias": [out], ...}."""
        return {
            f"{name}.l{number}.{kind}": value.detach().numpy().copy()
            for name, layers in self.networks.items()
            for number, layer in enumerate(layers, start=1)
            for kind, value in zip(("weight", "bias"), layer)
        }


# ---------------------------------------------------------------------------------------------
# Random inputs
# ---------------------------------------------------------------------------------------------


def network_sizes(settings):
    """Sizes of the layers of every network, inputs first."""
    rules = RULES[settings.task]
    previous = rules.actions if settings.beta < 1 else 0
    outputs = rules.actions * (2 if settings.base == "sac" else 1)  # means, then log-deviations
    actor = [rules.size + previous, *settings.hidden, outputs]
    critic = [rules.size + previous + rules.actions, *settings.hidden, 1]
    sizes = {"actor": actor} | {name: critic for name in settings.critics}
    sizes |= {f"target_{name}": layers for name, layers in sizes.items()}
    if settings.base == "sac":
        del sizes["target_actor"]
    if settings.has_model:
        predicted = rules.size - len(rules.known) + (settings.reward == "learned")
        sizes["model"] = [rules.size + rules.actions, *settings.model_hidden, predicted]
    return sizes


def draw_inputs(settings):
    """Networks, batches and noise of a case, float32, drawn from its seed."""
    rng = np.random.default_rng(settings.seed)
    rules, n = settings.rules, settings.batch_size
    mean, deviation = np.array(rules.mean), np.array(rules.deviation)
    inputs = {"in.scaling.mean": mean, "in.scaling.deviation": deviation}

    # Targets differ from the online networks, so that a mix-up shows. The model's wide last
    # layer sends some predictions beyond the clipping bound of scaled observations.
    for name, sizes in network_sizes(settings).items():
        for number, (fan_in, fan_out) in enumerate(pairwise(sizes), start=1):
            last = number == len(sizes) - 1
            gain = (2.0 if name == "model" else 1.0) if last else np.sqrt(2.0)
            weight = rng.standard_normal((fan_in, fan_out)) * gain / np.sqrt(fan_in)
            inputs[f"in.{name}.l{number}.weight"] = weight
            inputs[f"in.{name}.l{number}.bias"] = 0.1 * rng.standard_normal(fan_out)
    if settings.base == "sac":
        inputs["in.log_alpha"] = np.log([settings.initial_temperature])
        # Log-deviations spread so far that some are clamped, at both bounds.
        last, log_deviations = len(settings.hidden) + 1, slice(rules.actions, None)
        inputs[f"in.actor.l{last}.weight"][:, log_deviations] *= 3.0
        inputs[f"in.actor.l{last}.bias"][log_deviations] -= 3.0

    def transitions():
        s = mean + 1.2 * deviation * rng.standard_normal((n, rules.size))
        s[0] = mean + 7 * deviation * rng.choice([-1, 1], rules.size)  # beyond the clipping bound
        s_next = s + 0.5 * deviation * rng.standard_normal(s.shape)
        known = list(rules.known)
        s_next[:, known] = s[:, known]
        p = rng.uniform(-rules.a_max, rules.a_max, (n, rules.actions))
        p[:4] = 0  # first step of an episode
        u = rng.uniform(-rules.a_max, rules.a_max, (n, rules.actions))
        a = settings.beta * u + (1 - settings.beta) * p
        return [x.astype(np.float32) for x in (s, a, s_next, p)]

    def normal():
        noise = rng.standard_normal((n, rules.actions))
        noise[0], noise[1] = 4, -4  # beyond every clipping bound
        return noise

    def rewards(s, a, s_next):
        reward = rules.reward(*(torch.tensor(x, dtype=torch.float64) for x in (s, a, s_next))).numpy()
        if settings.task != "InvertedPendulum-v4":  # there the reward is exactly 1
            reward = reward + 0.05 * rng.standard_normal(n)  # the simulator's is not quite the rule's
        return reward

    def batch(name):
        s, a, s_next, p = transitions()
        return {
            f"{name}.obs": s,
            f"{name}.action": a,
            f"{name}.reward": rewards(s, a, s_next),
            f"{name}.next_obs": s_next,
            f"{name}.terminated": rules.terminated(torch.tensor(s_next)).numpy(),
            f"{name}.prev_action": p,
        }

    for i in range(settings.steps):
        inputs |= batch(f"in.{i}.batch")
        if settings.base != "ddpg":
            inputs[f"in.{i}.noise.smoothing"] = normal()
        if settings.has_model:
            s, a, s_next, _ = transitions()
            inputs |= {
                f"in.{i}.model_batch.obs": s,
                f"in.{i}.model_batch.action": a,
                f"in.{i}.model_batch.next_obs": s_next,
            }
            if settings.reward == "learned":
                inputs[f"in.{i}.model_batch.reward"] = rewards(s, a, s_next)
        if settings.imagination:
            inputs |= {
                f"in.{i}.noise.imaginary": normal(),
                f"in.{i}.noise.smoothing_imaginary": normal(),
                f"in.{i}.noise.keep": rng.uniform(0, 1, n),
            }
        if settings.base == "sac":
            inputs[f"in.{i}.noise.policy"] = normal()
        if settings.critic_updates == 2:
            inputs |= batch(f"in.{i}.extra_batch")
            inputs[f"in.{i}.noise.smoothing_extra"] = normal()
    return {name: array.astype(np.float32) for name, array in inputs.items()}


# ---------------------------------------------------------------------------------------------
# Cases
# ---------------------------------------------------------------------------------------------


def compute(settings, inputs, dtype=torch.float64):
    """All steps of a case. Returns {"out.<i>.<name>": array} and the smallest distance to a tie."""
    learner = Learner(settings, inputs, dtype)
    outputs, closest = {}, np.inf
    for i in range(settings.steps):
        out, ties = learner.step(i, inputs)
        # `save_file` writes the memory as it lies, so nothing may be a view with gaps.
        outputs |= {
            f"out.{i}.{name}": np.ascontiguousarray(np.atleast_1d(x.double().numpy()))
            for name, x in out.items()
        }
        closest = min([closest, *(margin.min().item() for margin in ties if len(margin))])
    last = settings.steps - 1
    outputs |= {f"out.{last}.{name}": x.astype(np.float32) for name, x in learner.parameters().items()}
    return outputs, closest


def demand(condition, settings, what):
    if not condition:
        sys.exit(f"{settings.case}: {what}; give the case another seed")


def inspect(settings, inputs, outputs, closest):
    """Refuses a case that decides nothing, or whose decisions rounding could turn.

    Returns the shares of the rows that pass the filters (or train, behind position 0), as text, and
    the largest errors of the same computation in single precision: of values (relative) and of
    parameters (absolute).
    """
    demand(closest > TIE, settings, f"a decision is only {closest:.1e} away from a tie")

    single, _ = compute(settings, inputs, torch.float32)
    value_error = parameter_error = 0.0
    for name, expected in outputs.items():
        error = np.abs(single[name] - expected).max()
        if name.endswith(("mask", ".d_hat", "_clamped")):
            demand(error == 0, settings, f"{name} differs in single precision")
        elif name.endswith((".weight", ".bias")):
            parameter_error = max(parameter_error, error)
        else:
            value_error = max(value_error, error / (np.abs(expected).max() or 1))
    # Adam divides by the size of the gradient: where a gradient is nearly 0, rounding decides.
    demand(parameter_error < 1e-6, settings, f"single precision moves a parameter by {parameter_error:.1e}")
    demand(value_error < 3e-6, settings, f"single precision moves a value by {value_error:.1e}")

    can_end = settings.task != "Reacher-v4"
    shares, maxima = [], [settings.running_max]
    if settings.base == "sac":
        clamped = sum(outputs[f"out.{i}.log_deviation_clamped"] for i in range(settings.steps))
        demand((clamped > 0).all(), settings, f"log-deviations clamped at either bound: {clamped}")
        count = settings.steps * settings.batch_size * settings.rules.actions
        demand(clamped.sum() < count / 2, settings, "most log-deviations are clamped")
    for i in range(settings.steps):
        ended = inputs[f"in.{i}.batch.terminated"].mean()
        demand(0 < ended < 1 or not can_end, settings, "no sampled row terminates")
        if settings.critic_updates == 2:
            ended = inputs[f"in.{i}.extra_batch.terminated"].mean()
            demand(0 < ended < 1 or not can_end, settings, "no row of the extra batch terminates")
        if settings.horizon > 0:
            trained = outputs[f"out.{i}.mask"].mean(1)
            shares.append("/".join(f"{share:.2f}" for share in trained[1:]))
            demand(trained[-1] > 0, settings, "no row trains at the last position")
            demand((np.diff(trained) < 0).all() == can_end, settings, "a position ends no row")
            demand(outputs[f"out.{i}.s_hat_clipped"] > 0, settings, "no prediction is clipped")
        if not settings.imagination:
            continue
        prefix = f"out.{i}."
        out = {name.removeprefix(prefix): x for name, x in outputs.items() if name.startswith(prefix)}
        target, uncertainty, kept = (
            out[name].mean() for name in ("target_mask", "uncertainty_mask", "keep_mask")
        )
        shares.append(f"{target:.2f}/{uncertainty:.2f}/{kept:.2f}")
        maxima.append(out.get("running_max", 0))
        demand(0 < out["d_hat"].mean() < 1 or not can_end, settings, "no imaginary row terminates")
        demand(out["s_hat_clipped"] > 0, settings, "no prediction is clipped")
        demand((0 < target < 1) == settings.target_filter, settings, "the target mask is trivial")
        if settings.case == "mamf_nothing_kept":
            demand(uncertainty == 0, settings, "a row is kept")
        else:
            expected = settings.uncertainty_filter
            demand((0 < uncertainty < 1) == expected, settings, "the uncertainty mask is trivial")
            demand(kept > 0, settings, "no row is kept")
        if settings.task == "InvertedPendulum-v4":
            demand((out["y"] == out["y_hat"]).any(), settings, "no exact tie")

    if "out.0.running_max" in outputs and settings.case != "mamf_nothing_kept":
        moved = [after > before for before, after in pairwise(maxima)]
        demand(any(moved) and not all(moved), settings, "the running maximum always or never moves")
    return "  ".join(shares), value_error, parameter_error


def write(folder):
    folder.mkdir(parents=True, exist_ok=True)
    total = 0
    print(
        "passed target filter / uncertainty filter / both, for each step, or trained at positions "
        "1 / 2 / ... of value expansion; closest tie; "
        "largest error of the same steps in float32: values (relative), parameters (absolute)"
    )
    for settings in CASES:
        inputs = draw_inputs(settings)
        outputs, closest = compute(settings, inputs)
        shares, value, parameter = inspect(settings, inputs, outputs, closest)
        path = folder / f"{settings.case}.safetensors"
        rules = RULES[settings.task]
        stored = asdict(settings) | {
            "a_max": rules.a_max,
            "observation_size": rules.size,
            "action_size": rules.actions,
            "known": rules.known,
        }
        save_file(inputs | outputs, path, metadata={"settings": json.dumps(stored, sort_keys=True)})
        total += path.stat().st_size
        print(f"{settings.case:27} {shares or '-':47} {closest:.1e}  {value:.1e}  {parameter:.1e}")
    print(f"{len(CASES)} files, {total / 1e6:.2f} MB in {folder}")


def read(path):
    with safe_open(path, framework="numpy") as file:
        stored = json.loads(file.metadata()["settings"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}
    fields = {name: stored[name] for name in Settings.__dataclass_fields__}
    return Settings(**fields), tensors


def check(folder):
    """Recomputes from the stored inputs and settings; exits with 1 where a result differs."""
    failures = 0
    for case in CASES:
        path = folder / f"{case.case}.safetensors"
        if not path.exists():
            sys.exit(f"{path} is missing: run this script without --check to write it")
        settings, stored = read(path)
        outputs, _ = compute(settings, {name: x for name, x in stored.items() if name.startswith("in.")})
        expected = {name: x for name, x in stored.items() if name.startswith("out.")}
        if expected.keys() != outputs.keys():
            sys.exit(f"{path}: results {sorted(expected.keys() ^ outputs.keys())} are in one of the two only")
        # Parameters are stored in float32, everything else in float64.
        wrong = [
            name
            for name, x in expected.items()
            if not np.allclose(outputs[name], x, rtol=0, atol=1e-7 if x.dtype == np.float32 else 1e-9)
        ]
        failures += bool(wrong)
        print(f"{settings.case:27} {len(expected)} results " + (f"DIFFER: {wrong}" if wrong else "agree"))
    sys.exit(1 if failures else 0)


def main():
    parser = argparse.ArgumentParser(
        description="Write (or check) the fixtures of one training step of each method in double precision."
    )
    default = Path(__file__).resolve().parent.parent / "tests/fixtures/update"
    parser.add_argument(
        "--out",
        type=Path,
        default=default,
        metavar="DIR",
        help="folder of the fixtures (default: %(default)s)",
    )
    parser.add_argument(
        "--check", action="store_true", help="recompute the stored fixtures and compare; write nothing"
    )
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    if arguments.check:
        check(arguments.out)
    else:
        write(arguments.out)


if __name__ == "__main__":
    main()
