"""Environment steps per second: the skating task, as mjlab steps it and as training does, beside mjlab's stock G1 task.

    python benchmarks/skate_throughput.py --device cuda --environments 4096 16384

Random actions of the policy's first size, no learning; the second half of the steps is timed.
"""

import argparse
import contextlib
import json
import sys
import time
from pathlib import Path

import torch
from mjlab.envs import ManagerBasedRlEnv

from policy_runtime.learning.fused_rewards import SkateEnv
from policy_runtime.learning.run_folder import LearnOptions
from sim.skate.options import SkateOptions
from sim.skate.task import skate_env_cfg
from sysid.workspace import Workspace


def stock(environments):
    from mjlab.tasks.velocity.config.g1.env_cfgs import unitree_g1_flat_env_cfg

    cfg = unitree_g1_flat_env_cfg()
    cfg.scene.num_envs = environments
    return cfg


def skating(environments):
    board = Workspace(Path()).load_board("pink")
    return skate_env_cfg(board, SkateOptions(), environments=environments, seed=1)


TASKS = {
    "mjlab's G1 velocity": (ManagerBasedRlEnv, stock),
    "skating, stepped by mjlab": (ManagerBasedRlEnv, skating),
    "skating, as it is trained": (SkateEnv, skating),
}


def measure(kind, cfg, device, steps):
    with contextlib.redirect_stdout(sys.stderr):
        env = kind(cfg, device)
    env.reset()
    actions = env.action_manager.total_action_dim
    for step in range(2 * steps):
        if step == steps:
            synchronise(device)
            began = time.perf_counter()
        env.step(0.5 * torch.randn(env.num_envs, actions, device=device))
    synchronise(device)
    seconds = (time.perf_counter() - began) / steps
    result = {
        "environments": env.num_envs,
        "solver_iterations": env.sim.mj_model.opt.iterations,
        "steps_per_s": round(env.num_envs / seconds),
        "collecting_s": round(LearnOptions().steps * seconds, 3),  # of an iteration
        "constraints_most": int(env.sim.data.nefc.max()),
        "contacts_mean": round(float(env.sim.data.nacon.sum()) / env.num_envs, 1),
    }
    env.close()
    return result


def synchronise(device):
    if device != "cpu":
        torch.cuda.synchronize()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--environments", type=int, nargs="+", default=[4096, 16384])
    parser.add_argument("--steps", type=int, default=48)
    arguments = parser.parse_args()
    for environments in arguments.environments:
        for task, (kind, cfg) in TASKS.items():
            result = measure(kind, cfg(environments), arguments.device, arguments.steps)
            print(json.dumps({"task": task} | result), flush=True)


if __name__ == "__main__":
    main()
