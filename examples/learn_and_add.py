"""Which effect the model is missing; with it added, the error falls to the sensor's noise."""

import sysid

log = sysid.Recording.read("tip.csv")
board = sysid.Board.load("pink")
found = sysid.diagnose(log, board)
print(f"{found.status}: {', '.join(found.effects)}. {found.verdict.explanation}")
print(found.to_dataframe()[["effects", "rmse", "score"]].head())

fit = sysid.fit(log, board, effects=found.effects)
for rung in fit.ladder:
    print(f"{rung.label:20} {rung.rmse / fit.noise.std:5.2f} × the noise")
print(fit.to_dataframe()[["value", "low", "high", "unit"]])

before, after = (sysid.compare(log, record).nrmse for record in (board, fit.board))
print(f"error: {100 * before:.1f} % of the motion before, {100 * after:.1f} % after")
fit.board.save("boards/pink.toml")
