"""Where a model parts from a measurement: in time, amplitude, velocity, side and phase, as words and as a picture."""

import sysid
from reports.figures.compare import compare_figure

log = sysid.Recording.read("tip.csv")
result = sysid.compare(log, sysid.Board.load("pink"))
print(result.report())
for place in result.where[:5]:
    print(f"{100 * place.share:3.0f} % of the error {place.text}")
print(result.to_dataframe())

compare_figure(result, "pink: simulated against tip.csv").savefig("where.png", dpi=140)
