"""Every log of a folder in one table: one row a log, or the reason why it has none."""

from pathlib import Path

import pandas as pd

import sysid

board = sysid.Board.load("pink")
rows = []
for path in sorted(Path("logs").glob("*.csv")):
    try:
        decay = sysid.fit_decay(sysid.Recording.read(path), board=board)
    except sysid.SysidError as error:
        rows.append({"log": path.name, "problem": str(error)})
        continue
    numbers = {name: quantity.value for name, quantity in decay.numbers.items()}
    rows.append({"log": path.name, "linear": decay.linear, **numbers, "warnings": len(decay.warnings)})
table = pd.DataFrame(rows).set_index("log")
table.to_csv("decays.csv")
print(table[["omega_n", "damping_ratio", "stiffness", "damping"]])
