"""Environment steps per second: the skating task beside mjlab's stock G1 velocity task, in one run.

    python benchmarks/skate_throughput.py --device cuda --environments 4096 16384 [--iterations 10 5] [--gpus 2]

Each as it is trained: mjlab's own environment, and ours that steps in CUDA graphs. Random actions of the policy's
first size, no learning; the second half of the steps is timed, and begins at once on all GPUs.
"""

import argparse
import contextlib
import dataclasses
import json
import multiprocessing
import os
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


def make_env(arguments, environments, iterations):
    if iterations is None:
        return ManagerBasedRlEnv(stock_cfg(environments), device=arguments.device)
    board = Workspace(Path()).load_board(arguments.board)
    cfg = skate_env_cfg(board, SkateOptions(), environments=environments, seed=1)
    cfg.sim.mujoco = dataclasses.replace(cfg.sim.mujoco, jacobian=arguments.jacobian, iterations=iterations)
    return SkateEnv(cfg, device=arguments.device)


def measure(gpu, meet, answers, arguments, *scene):
    os.environ["CUDA_VISIBLE_DEVICES"] = str(gpu)
    with contextlib.redirect_stdout(sys.stderr):
        env = make_env(arguments, *scene)
    env.reset()
    actions = env.action_manager.total_action_dim
    for step in range(2 * arguments.steps):
        if step == arguments.steps:
            synchronise(arguments.device)
            meet.wait()
            began = time.perf_counter()
        env.step(0.5 * torch.randn(env.num_envs, actions, device=arguments.device))
    synchronise(arguments.device)
    seconds = time.perf_counter() - began
    constraints, contacts = env.sim.data.nefc.max(), env.sim.data.nacon.sum()
    answers.put((env.num_envs * arguments.steps / seconds, int(constraints), float(contacts) / env.num_envs))


def synchronise(device):
    if device != "cpu":
        torch.cuda.synchronize()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda")
    parser.add_argument(
        "--gpus", type=int, default=1, help="each with so many environments, in a process of its own"
    )
    parser.add_argument("--environments", type=int, nargs="+", default=[4096])
    parser.add_argument("--steps", type=int, default=48)
    parser.add_argument("--board", default="pink")
    parser.add_argument("--tasks", nargs="+", default=["stock", "skate"])
    parser.add_argument("--jacobian", default="auto", help="auto, dense or sparse, for the skating task")
    parser.add_argument(
        "--iterations", type=int, nargs="+", default=[ITERATIONS], help="of the solver, for the skating task"
    )
    arguments = parser.parse_args()
    spawn = multiprocessing.get_context("spawn")
    for environments in arguments.environments:
        for task in arguments.tasks:
            for iterations in arguments.iterations if task == "skate" else [None]:
                meet, answers = spawn.Barrier(arguments.gpus), spawn.Queue()
                given = (meet, answers, arguments, environments, iterations)
                processes = [
                    spawn.Process(target=measure, args=(gpu, *given)) for gpu in range(arguments.gpus)
                ]
                for process in processes:
                    process.start()
                for process in processes:
                    process.join()
                    if process.exitcode:
                        sys.exit(process.exitcode)
                rates, constraints, contacts = zip(*(answers.get() for _ in processes), strict=True)
                result = {
                    "task": task,
                    "gpus": arguments.gpus,
                    "environments_a_gpu": environments,
                    "jacobian": arguments.jacobian,
                    "iterations": iterations,
                    "steps_per_s": sum(rates),
                    "constraints_most": max(constraints),
                    "contacts_mean": sum(contacts) / arguments.gpus,
                }
                print(json.dumps(result), flush=True)


if __name__ == "__main__":
    main()
