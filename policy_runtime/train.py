# pyright: reportMissingImports=false, reportUnknownParameterType=false, reportUnknownLambdaType=false
"""The training loop: mjlab's worlds, rsl_rl's PPO with the style extension, one process a GPU.

`python -m policy_runtime.train FOLDER` goes on with the run in a folder (see `policy_runtime.learning.run_folder`);
under torchrun every process does its share. The command line writes the folder and calls this.
"""

import argparse
import contextlib
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from policy_runtime.learning.run_folder import RunConfig, RunFolder
from policy_runtime.motion.motions import PHASES, Motion, load_motions, style_reference
from sim.skate.mdp.actor_observation import part_of
from sim.skate.mdp.rewards._base import Clip
from sysid.board import load_board
from sysid.errors import SysidError
from sysid.files import atomic_path, sha256

if TYPE_CHECKING:
    from mjlab.rl import RslRlVecEnvWrapper

    from policy_runtime.learning.amp import AmpPPO
    from policy_runtime.learning.checkpoint import Done
    from policy_runtime.learning.curriculum import Curriculum, Level

Report = Callable[[dict[str, float]], None]


@dataclass(frozen=True, slots=True)
class Process:
    """This process among those of the run."""

    rank: int
    count: int
    device: str

    @property
    def leads(self) -> bool:
        """Whether this process writes files."""
        return self.rank == 0


def join_processes(device: str) -> Process:
    """Read torchrun's environment and join the other processes, if there are any, on 'cpu' or 'cuda'."""
    import torch

    count, rank = int(os.environ.get("WORLD_SIZE", "1")), int(os.environ.get("RANK", "0"))
    local = int(os.environ.get("LOCAL_RANK", "0"))
    if device == "cuda":
        device = f"cuda:{local}"
        torch.cuda.set_device(local)
    if count > 1 and not torch.distributed.is_initialized():
        torch.distributed.init_process_group("nccl" if device != "cpu" else "gloo")
    return Process(rank, count, device)


def train(
    folder: RunFolder,
    *,
    device: str,
    iterations: int | None = None,
    minutes: float = math.inf,
    report: Report | None = None,
) -> int:
    """Train from the folder's newest checkpoint, or from the start, and return the iterations done in all.

    Args:
        iterations: Iterations in all; the configuration's if None.
        minutes: Stop, with a checkpoint, after so much time.
        report: Called by the leading process with every iteration's numbers.
    """
    import torch

    config = folder.read_config()
    process = join_processes(device)
    deadline = time.monotonic() + 60 * minutes
    with contextlib.redirect_stdout(sys.stderr):
        env, algorithm = build(folder, config, process)
        start, level = restore(folder, config, env, algorithm, process)
    if process.count > 1:
        algorithm.broadcast_parameters()
    if iterations is not None:
        config = replace(config, learn=replace(config.learn, iterations=iterations))
    curriculum, done = build_curriculum(config, env, algorithm, level), start.iterations
    for numbers in _learn(folder, config, env, algorithm, curriculum, process, start, deadline):
        done = int(numbers["iteration"])
        if report is not None and process.leads:
            report(numbers)
    env.close()
    if process.count > 1:
        torch.distributed.barrier()
        torch.distributed.destroy_process_group()
    return done


def build(folder: RunFolder, config: RunConfig, process: Process) -> tuple["RslRlVecEnvWrapper", "AmpPPO"]:
    """Build the worlds and the learner of a run."""
    import torch
    from mjlab.rl import RslRlVecEnvWrapper
    from mjlab.utils.torch import configure_torch_backends

    from policy_runtime.learning.fused_rewards import SkateEnv
    from sim.skate.task import skate_env_cfg

    configure_torch_backends()
    seed = config.learn.seed + process.rank
    torch.manual_seed(seed)
    env_cfg = skate_env_cfg(
        load_board(folder.board),
        config.task,
        environments=config.learn.environments,
        seed=seed,
        clips=push_clips(folder.motions()) if config.task.pushing == "tracking" else (),
    )
    env = RslRlVecEnvWrapper(SkateEnv(env_cfg, process.device))
    return env, build_learner(env, config, process, load_motions(folder.motions()))


def push_clips(paths: Sequence[Path] = ()) -> tuple[Clip, ...]:
    """Return the reference motions of pushing as the task follows them: whole pushes, from touchdown to touchdown."""
    from policy_runtime.motion.motion_check import left_stance
    from sim.skate.robot.g1 import g1_spec

    model = g1_spec(visuals=False).compile()
    clips: list[Clip] = []
    for motion in load_motions(paths):
        stance = left_stance(motion, model)
        # A clip that repeats without a seam begins where its foot comes down.
        seamless = stance.planted[0] and not stance.planted[-1]
        ends = [0, len(motion.joints)] if seamless else [*stance.touchdowns]
        if len(ends) < 2:
            raise SysidError(
                f"{motion.name}: its left foot comes down {len(ends)} times; tracking needs a whole push, from one "
                "touchdown to the next. Record longer, or teach pushing by style (--set pushing=amp)."
            )
        clips.append((motion.speed, motion.joints[ends[0] : ends[-1]]))
    return tuple(clips)


def build_learner(env: Any, config: RunConfig, process: Process, pushing: Sequence[Motion] = ()) -> "AmpPPO":
    """Build PPO with the style extension for worlds; `pushing` are reference motions instead of the shipped."""
    import torch

    from policy_runtime.learning.amp import AmpOptions, AmpPPO

    learn, task = config.learn, config.task
    amp = AmpOptions(
        weight=learn.style_weight if task.styled else 0.0,
        phases=len(PHASES) if task.transition == "style" else 0,
    )
    model = {
        "class_name": "MLPModel",
        "hidden_dims": learn.hidden,
        "activation": "elu",
        "obs_normalization": True,
    }
    gaussian = {"class_name": "GaussianDistribution", "init_std": learn.initial_std, "std_type": "scalar"}
    settings: dict[str, Any] = {
        "num_steps_per_env": learn.steps,
        "obs_groups": {"actor": ["actor"], "critic": ["critic"]},
        "multi_gpu": None
        if process.count == 1
        else {"global_rank": process.rank, "local_rank": process.rank, "world_size": process.count},
        "actor": model | {"distribution_cfg": gaussian},
        "critic": dict(model),
        "algorithm": {
            "class_name": AmpPPO,
            "amp": amp,
            "reference": torch.tensor(style_reference(task, pushing), dtype=torch.float),
            "num_learning_epochs": learn.epochs,
            "num_mini_batches": learn.mini_batches,
            "clip_param": learn.clip,
            "value_loss_coef": learn.value_weight,
            "entropy_coef": learn.entropy,
            "learning_rate": learn.learning_rate,
            "desired_kl": learn.desired_kl,
            "gamma": learn.gamma,
            "lam": learn.lam,
            "max_grad_norm": learn.gradient_norm,
            "schedule": "adaptive",
            "rnd_cfg": None,
            "symmetry_cfg": None,
        },
    }
    with contextlib.redirect_stdout(sys.stderr):
        learner = AmpPPO.construct_algorithm(env.get_observations(), env, settings, process.device)
    assert isinstance(learner, AmpPPO)  # rsl_rl builds the class that the settings name
    learner.train_mode()
    return learner


def build_curriculum(
    config: RunConfig, env: "RslRlVecEnvWrapper", algorithm: "AmpPPO", level: "Level | None"
) -> "Curriculum | None":
    """Return the run's curriculum at a level, or None if the full task is trained from the start."""
    if not config.learn.curriculum:
        return None
    if config.task.stance_patience == 0:
        raise SysidError(
            "stance_patience is 0: a wrong stance never ends an episode, so the curriculum has no effect. Choose a "
            "patience, or --set curriculum=false."
        )
    from policy_runtime.learning.curriculum import Curriculum

    return Curriculum(env.unwrapped, algorithm, config.learn.last_entropy, level)


def restore(
    folder: RunFolder, config: RunConfig, env: "RslRlVecEnvWrapper", algorithm: "AmpPPO", process: Process
) -> "tuple[Done, Level | None]":
    """Load the newest checkpoint, if there is one, and return its counts and its level of difficulty.

    A run that goes on has the learner, the counters and the random numbers of its checkpoint, bit for bit;
    its worlds begin new episodes. A run that begins with another's checkpoint has its own seed and a new mean
    of the weights. Without a curriculum in the checkpoint it has the task's own patience, in nominal worlds.
    """
    from policy_runtime.learning.checkpoint import Done, grow_critic, read_checkpoint, set_random_state
    from policy_runtime.learning.curriculum import Level

    checkpoints = folder.checkpoints()
    if not checkpoints:
        return Done(), None
    path = checkpoints[-1]
    kept = read_checkpoint(path, process.device)
    begins = path == folder.started_from()
    if not algorithm.judges_alike(kept):  # on other windows: the discriminator starts anew
        kept = {key: value for key, value in kept.items() if key not in ("discriminator", "amp_optimiser")}
    if begins:
        grow_critic(kept, env.get_observations()["critic"].shape[1])
    try:
        algorithm.load(kept, None, strict=True)
    except (RuntimeError, KeyError, ValueError) as error:
        reason = str(error).strip().splitlines()[-1].strip()
        raise SysidError(f"{path}: does not fit this run's learner ({reason}).") from error
    env.unwrapped.common_step_counter = kept["step_counter"]
    states = kept["random"]
    if begins:
        algorithm.begin_anew(config.learn.restart_std)
    elif len(states) == process.count:
        set_random_state(states[process.rank], process.device)
        env.reset()  # else episodes would begin as they did when the run was new
    elif process.leads:
        print(  # noqa: T201
            f"{path}: of {len(states)} processes, not {process.count}; random numbers start from the seed",
            file=sys.stderr,
        )
    led = kept.get("curriculum")
    level = Level(patience=float(config.task.stance_patience)) if led is None else Level(**led)
    return Done(kept["iteration"], kept["samples"]), level


def save(
    folder: RunFolder,
    config: RunConfig,
    env: Any,
    algorithm: "AmpPPO",
    curriculum: "Curriculum | None",
    done: "Done",
    states: list[dict[str, Any]],
) -> None:
    """Write a checkpoint in one step, and its policy: the mean of the weights."""
    import torch

    from policy_runtime.learning.onnx_export import export_policy, policy_metadata

    content = algorithm.save() | {
        "iteration": done.iterations,
        "samples": done.samples,
        "step_counter": env.unwrapped.common_step_counter,
        "random": states,
    }
    if curriculum is not None:
        content["curriculum"] = asdict(curriculum.level)
    with atomic_path(folder.checkpoint(done.iterations)) as temporary:
        torch.save(content, temporary)
    metadata = policy_metadata(
        load_board(folder.board),
        sha256(folder.board),
        folder.path.name,
        turn_feedback=config.task.turn_feedback,
    )
    export_policy(algorithm.mean_actor.module, folder.policy, metadata)


def _learn(
    folder: RunFolder,
    config: RunConfig,
    env: Any,
    algorithm: "AmpPPO",
    curriculum: "Curriculum | None",
    process: Process,
    done: "Done",
    deadline: float,
) -> Iterator[dict[str, float]]:
    """Iterate up to the configured number of iterations or the deadline; yield the numbers of each before it is saved."""
    import torch

    from policy_runtime.learning.checkpoint import Done, random_states
    from policy_runtime.learning.progress import Progress

    progress, learn = Progress(env.unwrapped), config.learn
    lengths = torch.randint_like(env.episode_length_buf, int(env.max_episode_length))
    env.episode_length_buf = lengths  # else all worlds would time out together
    obs = env.get_observations()
    samples = learn.steps * learn.environments * process.count
    while done.iterations < learn.iterations:
        began = time.monotonic()
        obs = collect(env, algorithm, obs, learn.steps, progress)
        numbers = progress.read()  # waits for the device
        _say_broken(progress.broken(), process, done.iterations)
        collected = time.monotonic()
        numbers |= algorithm.update()
        check_finite(algorithm, numbers, done.iterations)
        done = Done(done.iterations + 1, done.samples + samples)
        ended = time.monotonic()
        numbers |= {
            "iteration": done.iterations,
            "samples": done.samples,
            "collect_s": collected - began,
            "learn_s": ended - collected,
            "steps_per_s": samples / (ended - began),
            "learning_rate": algorithm.learning_rate,
            "action_std": float(algorithm.get_policy().output_std.detach().mean()),
        }
        if curriculum is not None:
            numbers |= curriculum.numbers()
            curriculum.follow(numbers["falls_per_minute"])
        stop = _agreed(ended > deadline, process) or done.iterations >= learn.iterations
        saves = stop or done.iterations % learn.save_every == 0
        states = random_states(process.device) if saves else []
        if process.leads:
            folder.add_to_curves(numbers)
        yield numbers
        if saves and process.leads:
            save(folder, config, env, algorithm, curriculum, done, states)
        if stop:
            return


def collect(env: Any, algorithm: "AmpPPO", obs: Any, steps: int, progress: Any) -> Any:
    """Let the policy act for some steps and return the last observation; returns are computed too."""
    import torch

    with torch.inference_mode():
        for _ in range(steps):
            obs, rewards, dones, extras = env.step(algorithm.act(obs))
            algorithm.process_env_step(obs, rewards, dones, extras)
            progress.add(algorithm.style_reward)
        algorithm.compute_returns(obs)
    return obs


def _say_broken(worlds: list[int], process: Process, iteration: int) -> None:
    """Name the worlds whose simulation has broken down; their episodes have been ended."""
    if worlds:
        print(  # noqa: T201
            f"iteration {iteration}: position or velocity was not finite in {len(worlds)} worlds of process "
            f"{process.rank}, the first is {worlds[0]}; their episodes were ended",
            file=sys.stderr,
        )


def check_finite(algorithm: "AmpPPO", numbers: dict[str, float], iteration: int) -> None:
    """Stop when a loss is not finite, and name the first cause."""
    import torch

    bad = [name for name, value in numbers.items() if not math.isfinite(value)]
    if not bad:
        return
    seen: dict[str, Any] = {**algorithm.storage.observations, "reward": algorithm.storage.rewards}
    for name, values in seen.items():
        for step, world, column in torch.nonzero(~torch.isfinite(values))[:1].tolist():
            part = f" ({part_of(column)})" if name == "actor" else ""
            raise SysidError(
                f"iteration {iteration}: {name}, number {column}{part}, of world {world} is not finite at step {step}. "
                "The simulation has become unstable there; begin a new run with --from, the last checkpoint and another --seed."
            )
    raise SysidError(
        f"iteration {iteration}: {', '.join(bad)} is not finite although all observations and rewards are. "
        "Begin a new run with --from and the last checkpoint, and a lower --set learning_rate=RATE."
    )


def _agreed(flag: bool, process: Process) -> bool:
    """Return whether the flag is set in any process; all get the same answer."""
    if process.count == 1:
        return flag
    import torch

    said = torch.tensor(float(flag), device=process.device)
    torch.distributed.all_reduce(said)
    return bool(said > 0)


def main() -> None:
    """Continue a run; the entry point for torchrun."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--device", default="cuda", choices=("cpu", "cuda"))
    parser.add_argument("--iterations", type=int)
    parser.add_argument("--minutes", type=float, default=math.inf)
    arguments = parser.parse_args()
    try:
        train(
            RunFolder(arguments.folder),
            device=arguments.device,
            iterations=arguments.iterations,
            minutes=arguments.minutes,
            report=lambda numbers: print(one_line(numbers), file=sys.stderr),  # noqa: T201
        )
    except SysidError as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201
        raise SystemExit(error.exit_code) from None
    except KeyboardInterrupt:  # the command line that started this reports it
        raise SystemExit(130) from None


def one_line(numbers: dict[str, float]) -> str:
    """Return an iteration's main numbers on one line."""
    return (
        f"{numbers['iteration']:.0f}: {numbers['steps_per_s']:,.0f} steps/s  reward {numbers['reward']:.2f}  "
        f"survival {numbers['survival']:.2f}  falls/min {numbers['falls_per_minute']:.2f}  "
        f"speed error {numbers['speed_error']:.3f} m/s  heading error {numbers['heading_error']:.3f} rad  "
        f"wrong feet {numbers['wrong_push']:.3f} {numbers['wrong_steer']:.3f}  style {numbers['style']:.2f}  "
        f"stride {numbers['stride_period']:.2f} s  stance {numbers['stance_time']:.2f} s  travel {numbers['foot_travel']:.2f} m  "
        f"slip {numbers['slip']:.3f} m/s  std {numbers['action_std']:.2f}"
    )


if __name__ == "__main__":
    main()
