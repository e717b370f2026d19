#!/usr/bin/env python3
"""Times the training loop of TD3 of Stable-Baselines3 (PyTorch) or of SBX (JAX) on HalfCheetah.

A step of it is an action with exploration noise, a step of the simulator, and an update of batch 256 on
networks with hidden layers of 256. The first steps, in which actions are random, functions are compiled
and libraries fill their caches, are not timed; nothing is evaluated or saved.

    python scripts/peers/library_loop.py --library sbx --threads 2
"""

import argparse
import json
import os
import time
import warnings

TASK, BATCH, HIDDEN = "HalfCheetah-v4", 256, [256, 256]


def model(library, random_steps):
    """TD3 of `library` as it comes, but for the sizes."""
    import gymnasium
    import numpy as np
    from stable_baselines3.common.noise import NormalActionNoise

    if library == "sb3":
        from stable_baselines3 import TD3
    else:
        from sbx import TD3

    env = gymnasium.make(TASK)
    size = env.action_space.shape[0]
    return TD3(
        "MlpPolicy",
        env,
        learning_rate=3e-4,
        buffer_size=100_000,
        learning_starts=random_steps,
        batch_size=BATCH,
        train_freq=1,
        gradient_steps=1,
        gamma=0.98,
        tau=0.005,
        policy_delay=2,
        action_noise=NormalActionNoise(np.zeros(size), 0.1 * np.ones(size)),
        policy_kwargs={"net_arch": HIDDEN},
        device="cpu",
        seed=0,
    )


def clock(begin):
    """A callback that remembers when step number `begin` was over, and the last one."""
    from stable_baselines3.common.callbacks import BaseCallback

    class Clock(BaseCallback):
        began = None

        def _on_step(self):
            if self.num_timesteps == begin:
                self.began = time.perf_counter()
            return True

    return Clock()


def main():
    parser = argparse.ArgumentParser(description="Time a training loop of TD3.")
    parser.add_argument("--library", choices=["sb3", "sbx"], required=True)
    parser.add_argument("--threads", type=int, default=2, help="default: %(default)s")
    parser.add_argument("--random-steps", type=int, default=1000, help="default: %(default)s")
    parser.add_argument("--warm-up", type=int, default=2000, help="steps not timed (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=4000, help="steps timed (default: %(default)s)")
    arguments = parser.parse_args()

    # JAX takes as many threads as there are cores for it.
    cores = sorted(os.sched_getaffinity(0))[: arguments.threads]
    os.sched_setaffinity(0, cores)
    warnings.simplefilter("ignore")
    import torch

    torch.set_num_threads(arguments.threads)
    agent, timer = model(arguments.library, arguments.random_steps), clock(arguments.warm_up)
    agent.learn(arguments.warm_up + arguments.steps, callback=timer)
    seconds = time.perf_counter() - timer.began
    print(json.dumps({"ms_a_step": 1e3 * seconds / arguments.steps}))


if __name__ == "__main__":
    main()
