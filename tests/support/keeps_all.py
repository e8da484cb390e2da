"""Train the run in a folder, and keep what this process holds at the end: `torchrun keeps_all.py FOLDER`."""

import os
import sys
from pathlib import Path

import torch

from policy_runtime import train
from policy_runtime.learning.run_folder import RunFolder

built, build = [], train.build
train.build = lambda *given: built.append(build(*given)) or built[0]
folder = Path(sys.argv[1])
train.train(RunFolder(folder), device="cpu")
torch.save(built[0][1].save(), folder / f"process_{os.environ['RANK']}.pt")
