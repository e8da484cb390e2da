"""Environment steps per second: the skating task beside mjlab's stock G1 velocity task, in one run.

    python benchmarks/skate_throughput.py --device cuda --environments 4096 16384 [--iterations 10 5]

Each as it is trained: mjlab's own environment, and ours that steps in CUDA graphs. Random actions of the policy's
first size, no learning; the second half of the steps is timed.
"""

import argparse
import contextlib
import dataclasses
import json
import sys
import time
from pathlib import Path

import torch
from mjlab.envs import ManagerBasedRlEnv

from policy_runtime.learning.fused_rewards import SkateEnv
from sim.skate.options import SkateOptions
from sim.skate.task import skate_env_cfg
from sim.skate.world.scene import ITERATIONS
from sysid.workspace import Workspace


def stock_cfg(environments):
    from mjlab.tasks.velocity.config.g1.env_cfgs import unitree_g1_flat_env_cfg

    cfg = unitree_g1_flat_env_cfg()
    cfg.scene.num_envs = environments
    return cfg


def measure(make, cfg, device, steps):
    with contextlib.redirect_stdout(sys.stderr):
        env = make(cfg, device=device)
    env.reset()
    actions = env.action_manager.total_action_dim
    for step in range(2 * steps):
        if step == steps:
            synchronise(device)
            began = time.perf_counter()
        env.step(0.5 * torch.randn(env.num_envs, actions, device=device))
    synchronise(device)
    seconds = time.perf_counter() - began
    result = {
        "environments": env.num_envs,
        "steps_per_s": env.num_envs * steps / seconds,
        "constraints_most": int(env.sim.data.nefc.max()),
        "contacts_mean": float(env.sim.data.nacon.sum()) / env.num_envs,
    }
    env.close()
    return result


def synchronise(device):
    if device != "cpu":
        torch.cuda.synchronize()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--environments", type=int, nargs="+", default=[4096])
    parser.add_argument("--steps", type=int, default=48)
    parser.add_argument("--board", default="pink")
    parser.add_argument("--tasks", nargs="+", default=["stock", "skate"])
    parser.add_argument("--jacobian", default="auto", help="auto, dense or sparse, for the skating task")
    parser.add_argument(
        "--iterations", type=int, nargs="+", default=[ITERATIONS], help="of the solver, for the skating task"
    )
    arguments = parser.parse_args()
    board = Workspace(Path()).load_board(arguments.board)
    for environments in arguments.environments:
        for task in arguments.tasks:
            for iterations in arguments.iterations if task == "skate" else [None]:
                if iterations is None:
                    make, cfg = ManagerBasedRlEnv, stock_cfg(environments)
                else:
                    make = SkateEnv
                    cfg = skate_env_cfg(board, SkateOptions(), environments=environments, seed=1)
                    cfg.sim.mujoco = dataclasses.replace(
                        cfg.sim.mujoco, jacobian=arguments.jacobian, iterations=iterations
                    )
                result = {"task": task, "jacobian": arguments.jacobian, "iterations": iterations}
                print(json.dumps(result | measure(make, cfg, arguments.device, arguments.steps)), flush=True)


if __name__ == "__main__":
    main()
