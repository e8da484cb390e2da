import sysid

board = sysid.Board.load("pink")
log = sysid.Recording.read("tip.csv")            # columns, unit, clock, releases inferred; log.notes, log.warnings, log.releases
decay = sysid.fit_decay(log, inertia=board.inertia)
print(decay.report())                            # δ, ζ, ω_n, k, d ± 95 %, and what is not linear
found = sysid.diagnose(log, board)
print(found.report())                            # ranked models, probability of each, next experiment
fit = sysid.fit(log, board, effects=found.effects)
print(fit.law)                                   # 8.70e-3 φ̈ + 0.402 φ̇ + 14.68 φ + 0.151 sgn φ̇ = 0
print(fit.quantities["coulomb.torque"])          # 0.151 ± 0.004 N·m
print(sysid.compare(log, fit.board).summary)
fit.board.save("boards/pink.toml")
